"""Tasks on a Dask cluster: only the machine with the command writes into the output folder."""

import queue
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from app.batch.jobs import Task
from app.batch.worker_process import ENOUGH_MEMORY, MAX_DEATHS, WorkerProcess
from app.errors import AfterglowError, ProcessError
from app.extras import extra_module
from app.io.atomic_files import replace_file
from app.io.dask_client import EXTRA, connect_scheduler

_idle: queue.SimpleQueue[WorkerProcess] = queue.SimpleQueue()  # of a Dask worker, each with its renderer


def run_on_cluster(tasks: Sequence[Task], out: Path, scheduler: str, on_done: Callable[[Task, str], None]) -> None:
    """Draw ``tasks`` on the workers of a Dask scheduler, and write what they return into ``out``.

    Parameters
    ----------
    scheduler : str
        Its address.
    on_done : callable
        Called with each task, and what went wrong with it; empty if nothing did.

    Raises
    ------
    DeviceError
        When the scheduler can't be reached.
    """
    with connect_scheduler(scheduler) as client:
        tasks_of = {client.submit(draw_files, task, pure=False, retries=MAX_DEATHS - 1): task for task in tasks}
        for future in extra_module("distributed", EXTRA).as_completed(tasks_of):
            on_done(tasks_of[future], _receive(future, out))
            future.release()
        with suppress(OSError):  # the scheduler may have been lost
            client.run(end_idle_processes, on_error="ignore")


def draw_files(task: Task) -> tuple[str, dict[str, bytes]]:
    """What went wrong with ``task``, empty if nothing did, and the files that it makes, its record last.

    Raises
    ------
    ProcessError
        When the process that draws dies; a crash of a driver does not take the Dask worker with it.
    """
    try:
        process = _idle.get_nowait()
    except queue.Empty:
        process = WorkerProcess()
    with TemporaryDirectory() as folder:
        error = process.draw(task, Path(folder))
        _idle.put(process)
        if error is None:
            raise ProcessError("workers died with it", task.job.name, ENOUGH_MEMORY)
        files = {str(f.relative_to(folder)): f.read_bytes() for f in Path(folder).rglob("*") if f.is_file()}
        return error, dict(sorted(files.items(), key=lambda item: item[0] == task.record))


def end_idle_processes() -> None:
    """End the processes of a Dask worker that draw nothing now."""
    with suppress(queue.Empty):
        while True:
            _idle.get_nowait().end()


def _receive(future: Any, out: Path) -> str:
    """Write the files of a task; return what went wrong."""
    try:
        error, files = future.result()
        for name, content in files.items():
            with replace_file(out / name) as temporary:
                temporary.parent.mkdir(parents=True, exist_ok=True)
                temporary.write_bytes(content)
    except AfterglowError as problem:
        return str(problem)
    except Exception as problem:  # of Dask, such as that workers died with the task
        return " ".join(f"{type(problem).__name__}: {problem}".split())
    return str(error)
