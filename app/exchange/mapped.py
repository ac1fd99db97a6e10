"""Tensors in memory that OpenGL and onnxruntime's CPU provider both see."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING

import moderngl
import numpy as np

from app.arrays import F32
from app.exchange.shared import SharedExchange
from app.gl.context import Device

if TYPE_CHECKING:
    from app.network.session import Network


class MappedExchange(SharedExchange):
    """Keeps its buffers mapped, and binds onnxruntime to their memory once."""

    name = "mapped"

    def __init__(self, device: Device, network: Network, size: tuple[int, int]) -> None:
        self._addresses: dict[int, int] = {}  # of the memory of buffers, by their number in GL
        super().__init__(device, network, size)
        self._run = network.bind({t: self._addresses[buffer.glo] for t, buffer in self.buffers.items()}, size)

    def _allocate(self, size: int) -> moderngl.Buffer:
        buffer, address = self._device.map_buffer(size)
        self._addresses[buffer.glo] = address
        return buffer

    def _values(self, tensor: str) -> F32:
        """The memory of a tensor, valid until the exchange is released."""
        address = ctypes.cast(self._addresses[self.buffers[tensor].glo], ctypes.POINTER(ctypes.c_float))
        return np.ctypeslib.as_array(address, self.shapes[tensor])

    def _write(self, tensor: str, values: F32) -> None:
        self._values(tensor)[0] = values

    def _read(self, tensor: str) -> F32:
        return self._values(tensor)

    def _infer(self) -> None:
        self._device.ctx.finish()  # the passes before
        self._run()
