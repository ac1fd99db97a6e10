"""Tensors in GL buffers that onnxruntime reads and writes: the GPU prepares the inputs and unpacks the outputs."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING

import moderngl
import numpy as np

from app.arrays import F32
from app.exchange.exchange import Exchange
from app.exchange.exposure import Exposure, is_exposed
from app.gl.context import Device
from app.gl.pool import Resources
from app.network.channels import HALF_MAX
from app.network.inputs import channel_bounds, clamp

if TYPE_CHECKING:
    from app.network.session import Network


class SharedExchange(Exchange):
    """One GL buffer for each tensor of the graph, float32, with the batch and the padded grid.

    OpenGL must not use them while onnxruntime runs.
    """

    def __init__(self, device: Device, network: Network, size: tuple[int, int]) -> None:
        contract = self._contract = network.contract
        self._device = device
        self.shapes = contract.padded_shapes({**contract.inputs, **contract.outputs}, size)
        self.buffers = {t: self._allocate(4 * math.prod(shape)) for t, shape in self.shapes.items()}
        self._exposure = Exposure(device, contract, self.buffers, size)
        self._stored: dict[str, F32] = {}
        self._rows = {channel: (tensor, rows) for tensor, spec in contract.outputs.items()
                      for channel, rows in spec.rows()}

    def run(self, tensors: Mapping[str, moderngl.Buffer | F32]) -> None:
        packed = {}
        for tensor, values in tensors.items():
            spec = self._contract.inputs[tensor]
            if not isinstance(values, np.ndarray):
                packed[tensor] = values
            elif is_exposed(spec):
                self._write(tensor, values)
                packed[tensor] = self.buffers[tensor]
            elif self._stored.get(tensor) is not values:
                self._write(tensor, clamp(values, *channel_bounds(spec)))
                self._stored[tensor] = values
        self._exposure.expose(packed)
        self._infer()

    def read(self, channel: str) -> F32:
        tensor, rows = self._rows[channel]
        light = clamp(self._read(tensor)[0], *channel_bounds(self._contract.outputs[tensor]))[rows]
        return np.minimum(light * self._exposure.read_mean(), np.float32(HALF_MAX))

    def draw(self, channel: str, resources: Resources, target: str) -> None:
        tensor, rows = self._rows[channel]
        resources.target(target)
        self._exposure.unpack(self.buffers[tensor], self.shapes[tensor], rows.start)

    def release(self) -> None:
        for buffer in self.buffers.values():
            buffer.release()
        self._exposure.release()

    def _allocate(self, size: int) -> moderngl.Buffer:
        """A buffer of ``size`` bytes."""
        return self._device.ctx.buffer(reserve=size)

    def _write(self, tensor: str, values: F32) -> None:
        """Replace an input."""
        self.buffers[tensor].write(values)

    def _read(self, tensor: str) -> F32:
        """An output, shape (1, C, …)."""
        return np.frombuffer(self.buffers[tensor].read(), np.float32).reshape(self.shapes[tensor])

    @abstractmethod
    def _infer(self) -> None:
        """Run onnxruntime on the buffers, after what passes have written and before what they read."""
