"""Makes what a dataset lacks, on the cores of this machine or on a Dask cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from app.errors import DeviceError, SettingsError
from app.extras import extra_module
from app.io.atomic_files import prepare_folders
from export.dataset.config import Config
from export.dataset.dataset import config_of, read_about, write_about
from export.dataset.make import make_group
from export.dataset.plan import plan
from export.dataset.store import Origin, item_path, read_origin, write_item

RETRIES = 3  # of a group whose worker died
CONNECT_SECONDS = 30


def make_dataset(folder: Path, config: Config, seed: int, pairs: int, scheduler: str | None = None,
                 workers: int | None = None, progress: Callable[[int], object] = lambda done: None) -> int:
    """Make the missing, corrupt and outdated ones of the first ``pairs`` pairs in ``folder``.

    Parameters
    ----------
    scheduler : str or None
        Address of a Dask scheduler; None: ``workers`` processes on this machine, as many as cores without.
    progress : callable
        Told the number of pairs that were just done.

    Returns
    -------
    int
        How many were made now.

    Raises
    ------
    SettingsError
        When the folder holds a dataset of another configuration or seed.
    DeviceError
        When the scheduler can't be reached.
    """
    about = read_about(folder)
    if about is not None and (config_of(about) != config or about["seed"] != seed):
        raise SettingsError("this folder holds a dataset of another configuration or seed", folder,
                            "expected a new folder, or the same configuration and seed")
    prepare_folders(folder)
    write_about(folder, config, seed, max(pairs, about["pairs"] if about else 0))
    made = 0
    with _client(scheduler, workers) as client:
        jobs = {}
        for group in plan(config, pairs):
            wanted = group.within(pairs)
            job = client.submit(make_group, config, seed, group, wanted, _known(folder, wanted), pure=False,
                                retries=RETRIES)
            jobs[job] = wanted
        for job in extra_module("distributed", "export").as_completed(jobs):
            for index, content in job.result().items():
                write_item(item_path(folder, index), content)
                made += 1
            progress(len(jobs[job]))
            job.release()
    return made


def _known(folder: Path, wanted: range) -> dict[int, Origin]:
    """Origins of those of the ``wanted`` files that are there and sound."""
    found = {i: read_origin(item_path(folder, i)) for i in wanted}
    return {i: origin for i, origin in found.items() if origin is not None}


@contextmanager
def _client(scheduler: str | None, workers: int | None) -> Iterator[Any]:
    """A Dask client, of workers with one thread each."""
    distributed = extra_module("distributed", "export")
    if scheduler is not None:
        try:
            client = distributed.Client(scheduler, timeout=CONNECT_SECONDS)
        except (OSError, ValueError) as error:
            raise DeviceError(f"can't reach the scheduler ({' '.join(str(error).split())})", scheduler,
                              "expected the address of a running one, such as tcp://host:8786") from None
        with client:
            yield client
        return
    count = workers or len(os.sched_getaffinity(0))
    with (distributed.LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None, memory_limit=0,
                                   silence_logs=50) as cluster, distributed.Client(cluster) as client):
        yield client
