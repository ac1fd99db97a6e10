"""A child process that draws tasks, so that nothing but its task is lost when it dies."""

import json
import subprocess
import sys
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from app.batch.jobs import Task
from app.io.atomic_files import remove_temporary_files
from app.io.child_process import child_environment

MAX_DEATHS = 3  # of processes with the same task
ENOUGH_MEMORY = "expected enough memory for its scene and size"
WORKER = "app.batch.worker"


class WorkerProcess:
    """Starts its process with the first task, and another one after a death."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def draw(self, task: Task, out: Path) -> str | None:
        """Draw ``task`` into the folder ``out``.

        Returns
        -------
        str or None
            What went wrong, empty if nothing did; None if the process died.
        """
        process = self._process = self._process or self._start()
        assert process.stdin is not None and process.stdout is not None
        with suppress(BrokenPipeError):
            process.stdin.write(json.dumps({"task": asdict(task), "out": str(out)}) + "\n")
            process.stdin.flush()
        if (answer := process.stdout.readline()).endswith("\n"):
            return str(json.loads(answer))
        self.end()
        remove_temporary_files(out / task.job.name, process.pid)
        return None

    def end(self) -> None:
        """Close the standard input of the process, at whose end it ends, and wait for that."""
        if self._process is not None:
            with suppress(BrokenPipeError):
                self._process.communicate()
        self._process = None

    def _start(self) -> subprocess.Popen[str]:
        return subprocess.Popen([sys.executable, "-P", "-m", WORKER], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                stderr=subprocess.DEVNULL, text=True, env=child_environment())
