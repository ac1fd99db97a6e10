"""Tensors by copies: the CPU prepares the inputs and unpacks the outputs of any network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import moderngl
import numpy as np

from app.arrays import F32
from app.exchange.exchange import Exchange
from app.gl.context import Device
from app.gl.pool import Resources
from app.network.bounces import RepeatedNetwork
from app.network.channels import SEEN

if TYPE_CHECKING:
    from app.network.session import Network


class CopyExchange(Exchange):
    """Reads tensors back and writes textures."""

    name = "copy"

    def __init__(self, device: Device, network: Network | RepeatedNetwork, size: tuple[int, int]) -> None:
        self._network = network
        self._read = {t: np.empty(spec.shape(size), np.float32) for t, spec in network.contract.inputs.items()
                      if spec.grid in SEEN}
        self._pixels = np.ones((size[1], size[0], 4), np.float16)
        self._outputs: dict[str, F32] = {}

    def run(self, tensors: Mapping[str, moderngl.Buffer | F32]) -> None:
        inputs = dict(self._read)
        for tensor, values in tensors.items():
            if isinstance(values, np.ndarray):
                inputs[tensor] = values
            else:
                values.read_into(inputs[tensor])  # waits for the passes before
        self._outputs = self._network.run(inputs)

    def read(self, channel: str) -> F32:
        return self._outputs[channel]

    def draw(self, channel: str, resources: Resources, target: str) -> None:
        self._pixels[..., :3] = np.moveaxis(self._outputs[channel], 0, -1)[::-1]  # tensors are top-down, GL bottom-up
        resources[target].write(self._pixels)

    def release(self) -> None:
        """Nothing: it has no buffers on the GPU."""
