"""Worker processes that are replaced when they die."""

import json
import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from app.batch.jobs import Task
from app.io.atomic_files import remove_temporary_files
from app.io.child_process import child_environment

MAX_DEATHS = 3  # of workers with the same task
WORKER = "app.batch.worker"


def run_tasks(tasks: Sequence[Task], out: Path, workers: int, on_done: Callable[[Task, str], None]) -> None:
    """Draw ``tasks`` into ``out``; one whose worker dies is drawn again by another.

    Parameters
    ----------
    on_done : callable
        Called from several threads with each task, and what went wrong with it; empty if nothing did.
    """
    waiting: queue.SimpleQueue[Task] = queue.SimpleQueue()
    for task in tasks:
        waiting.put(task)
    threads = [threading.Thread(target=_Worker(waiting, out, on_done).run) for _ in range(min(workers, len(tasks)))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


class _Worker:
    """Passes tasks to one process after another."""

    def __init__(self, waiting: "queue.SimpleQueue[Task]", out: Path, on_done: Callable[[Task, str], None]) -> None:
        self._waiting, self._out, self._on_done = waiting, out, on_done
        self._process: subprocess.Popen[str] | None = None

    def run(self) -> None:
        with suppress(queue.Empty):
            while True:
                task = self._waiting.get_nowait()
                self._on_done(task, self._draw(task))
        self._end()

    def _draw(self, task: Task) -> str:
        for _ in range(MAX_DEATHS):
            process = self._process = self._process or self._start()
            assert process.stdin is not None and process.stdout is not None
            with suppress(BrokenPipeError):
                process.stdin.write(json.dumps(asdict(task)) + "\n")
                process.stdin.flush()
            if answer := process.stdout.readline():
                return str(json.loads(answer))
            self._end()
            remove_temporary_files(self._out / task.job.name, process.pid)
        return f"{task.job.name}: {MAX_DEATHS} workers died with it (expected enough memory for its scene and size)"

    def _start(self) -> subprocess.Popen[str]:
        return subprocess.Popen([sys.executable, "-P", "-m", WORKER, str(self._out)], stdin=subprocess.PIPE,
                                stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=child_environment())

    def _end(self) -> None:
        if self._process is not None:
            with suppress(BrokenPipeError):
                self._process.communicate()  # closes its standard input, at whose end it ends
        self._process = None
