"""A whole batch: what is missing is drawn, what is done is left alone."""

import os
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from app.batch.cluster import run_on_cluster
from app.batch.jobs import BadLine, Job, Task, tasks_of
from app.batch.pool import run_on_cores


@dataclass
class Outcome:
    """What became of a job.

    Attributes
    ----------
    drawn, kept : int
        Tasks that were drawn now, and that were there already.
    error : str
        Of the first task that failed; empty if none did.
    """

    name: str
    drawn: int = 0
    kept: int = 0
    error: str = ""


def run_batch(jobs: list[Job | BadLine], out: Path, progress: Callable[[int, int], object],
              scheduler: str | None = None, workers: int | None = None) -> list[Outcome]:
    """Draw all jobs into ``out``.

    Parameters
    ----------
    scheduler : str or None
        Address of a Dask scheduler; None for ``workers`` processes on this machine, by default one per core.
    progress : callable
        Called with the numbers of finished tasks and of all.

    Returns
    -------
    list of Outcome
        In the order of the jobs.
    """
    outcomes = {job.name: Outcome(job.name, error=job.error if isinstance(job, BadLine) else "") for job in jobs}
    missing: list[Task] = []
    for job in jobs:
        for task in tasks_of(job) if isinstance(job, Job) else ():
            if task.is_done(out):
                outcomes[job.name].kept += 1
            else:
                missing.append(task)
                with suppress(OSError):  # the record of other pictures, which must not vouch for half of these
                    (out / task.record).unlink()
    missing.sort(key=lambda task: repr(task.job.renderer_settings))
    done, lock = 0, threading.Lock()

    def finish(task: Task, error: str) -> None:
        nonlocal done
        with lock:
            outcome = outcomes[task.job.name]
            outcome.drawn += not error
            outcome.error = outcome.error or error
            done += 1
            progress(done, len(missing))

    progress(0, len(missing))
    if scheduler is None:
        run_on_cores(missing, out, workers or len(os.sched_getaffinity(0)), finish)
    else:
        run_on_cluster(missing, out, scheduler, finish)
    return list(outcomes.values())
