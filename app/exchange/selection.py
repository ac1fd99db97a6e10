"""Which exchange a network gets, and the exchanges of a renderer."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from app.exchange.copy import CopyExchange
from app.exchange.cuda import CudaExchange
from app.exchange.exchange import Exchange
from app.exchange.mapped import MappedExchange
from app.gl.context import Device
from app.network.bounces import RepeatedNetwork
from app.network.providers import CPU

if TYPE_CHECKING:
    from app.network.session import Network

OpenExchange = Callable[[Device, Any, tuple[int, int]], Exchange]  # of a network, as ``open_exchange``


def open_exchange(device: Device, network: Network | RepeatedNetwork, size: tuple[int, int]) -> Exchange:
    """The fastest exchange for ``network`` on a screen grid of ``size``: on a GPU, the one with the fewest copies.

    A software renderer's loads from buffers are so slow that numpy prepares tensors sooner (docs/design.md). Memory of
    the CPU that is bound to a session on a GPU would be copied there once, when it is bound.
    """
    if isinstance(network, RepeatedNetwork) or not network.is_bindable or device.software:
        return CopyExchange(device, network, size)
    if network.provider == CPU:
        return MappedExchange(device, network, size)
    if network.cuda is not None and network.cuda.shares_device():
        return CudaExchange(device, network, size, network.cuda)
    return CopyExchange(device, network, size)


class Exchanges:
    """One exchange for each network and size of its screen grid, opened when a pass asks for it."""

    def __init__(self, open_one: OpenExchange = open_exchange) -> None:
        self._open_one = open_one
        self._open: dict[tuple[int, tuple[int, int]], Exchange] = {}

    def get(self, device: Device, network: Network | RepeatedNetwork, size: tuple[int, int]) -> Exchange:
        """The exchange of a ``network`` that lives as long as this object, for a screen grid of ``size``."""
        key = id(network), size
        if key not in self._open:
            self._open[key] = self._open_one(device, network, size)
        return self._open[key]

    @property
    def names(self) -> str:
        """The exchanges in use, or ``none``."""
        return ", ".join(sorted({exchange.name for exchange in self._open.values()})) or "none"

    def release(self) -> None:
        """Free all buffers."""
        for exchange in self._open.values():
            exchange.release()
        self._open.clear()
