"""Tasks on the cores of this machine."""

import queue
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from app.batch.jobs import Task
from app.batch.worker_process import ENOUGH_MEMORY, MAX_DEATHS, WorkerProcess


def run_on_cores(tasks: Sequence[Task], out: Path, workers: int, on_done: Callable[[Task, str], None]) -> None:
    """Draw ``tasks`` into ``out`` by ``workers`` processes.

    Parameters
    ----------
    on_done : callable
        Called from several threads with each task, and what went wrong with it; empty if nothing did.
    """
    waiting: queue.SimpleQueue[tuple[Task, int]] = queue.SimpleQueue()  # with the number of workers that died with it
    for task in tasks:
        waiting.put((task, 0))
    stopped = threading.Event()

    def work() -> None:
        process = WorkerProcess()
        with suppress(queue.Empty):
            while not stopped.is_set():
                task, deaths = waiting.get_nowait()
                error = process.draw(task, out)
                if error is not None:
                    on_done(task, error)
                elif deaths + 1 == MAX_DEATHS:
                    on_done(task, f"{task.job.name}: workers died with it ({ENOUGH_MEMORY})")
                else:
                    waiting.put((task, deaths + 1))  # last, so that it does not hold up the others
        process.end()

    with ThreadPoolExecutor(workers) as threads:
        try:
            for thread in [threads.submit(work) for _ in range(min(workers, len(tasks)))]:
                thread.result()
        finally:
            stopped.set()  # an interrupted batch ends with the tasks that are being drawn
