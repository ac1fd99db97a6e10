"""Makes the missing items of a dataset on the cores of this machine or on a Dask cluster."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from app.errors import SettingsError
from app.extras import extra_module
from app.io.atomic_files import prepare_folders
from app.io.dask_client import EXTRA, connect_scheduler
from export.dataset.config import Config
from export.dataset.dataset import About, read_about, write_about
from export.dataset.pair_worker import make_group
from export.dataset.plan import plan_groups
from export.dataset.store import item_path, read_origin, write_item

RETRIES = 3  # of a group whose worker died


def make_dataset(folder: Path, config: Config, seed: int, pairs: int, scheduler: str | None = None,
                 workers: int | None = None, progress: Callable[[int], object] = lambda done: None) -> int:
    """Make those of the first ``pairs`` pairs in ``folder`` that are missing, corrupt or outdated; return their number.

    Parameters
    ----------
    scheduler : str or None
        Address of a Dask scheduler; None for ``workers`` processes on this machine, by default one per core.
    progress : callable
        Called with the number of pairs just finished.

    Raises
    ------
    SettingsError
        When the folder holds a dataset of another configuration or seed.
    DeviceError
        When the scheduler can't be reached.
    """
    about = read_about(folder)
    if about is not None and (about.config, about.seed) != (config, seed):
        raise SettingsError("this folder holds a dataset of another configuration or seed", folder,
                            "expected a new folder, or the same configuration and seed")
    prepare_folders(folder)
    write_about(folder, About(config, seed, max(pairs, about.pairs if about else 0)))
    made = 0
    distributed = extra_module("distributed", EXTRA)
    with _connect(distributed, scheduler, workers) as client:
        indices_of = {}
        for group in plan_groups(config, pairs):
            indices = group.within(pairs)
            known = {i: origin for i in indices if (origin := read_origin(item_path(folder, i))) is not None}
            job = client.submit(make_group, config, seed, group, indices, known, pure=False, retries=RETRIES)
            indices_of[job] = indices
        for job in distributed.as_completed(indices_of):
            for index, content in job.result().items():
                write_item(item_path(folder, index), content)
                made += 1
            progress(len(indices_of[job]))
            job.release()
    return made


@contextmanager
def _connect(distributed: Any, scheduler: str | None, workers: int | None) -> Iterator[Any]:
    """A Dask client; workers on this machine have one thread each."""
    if scheduler is not None:
        with connect_scheduler(scheduler) as client:
            yield client
        return
    with (distributed.LocalCluster(n_workers=workers or len(os.sched_getaffinity(0)), threads_per_worker=1,
                                   dashboard_address=None, memory_limit=0, silence_logs=50) as cluster,
          distributed.Client(cluster) as client):
        yield client
