"""A Dask cluster, whose workers take the place of this machine's cores."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from app.errors import DeviceError
from app.extras import extra_module

EXTRA = "cluster"
CONNECT_SECONDS = 30


@contextmanager
def connect_scheduler(address: str) -> Iterator[Any]:
    """A ``distributed.Client`` of the scheduler at ``address``.

    Raises
    ------
    DeviceError
        When the scheduler can't be reached.
    MissingExtraError
        When the extra ``cluster`` is not installed.
    """
    distributed = extra_module("distributed", EXTRA)
    try:
        client = distributed.Client(address, timeout=CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        raise DeviceError(f"can't reach the scheduler ({' '.join(str(error).split())})", address,
                          "expected the address of a running one, such as tcp://host:8786") from None
    with client:
        yield client
