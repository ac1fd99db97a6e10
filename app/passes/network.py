"""One onnxruntime call: tensors in, low-resolution indirect light out."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from app.gl.context import Device
from app.gl.frame_state import FrameState
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex

if TYPE_CHECKING:
    from app.infer import Network

OUTPUT = "indirect.rgb"


def declare(network: Network, tensors: dict[str, str], shapes: dict[str, tuple[int, ...]],
            grid: tuple[int, int], output: str) -> Pass:
    """The pass that runs ``network`` into ``output``; ``tensors`` names the graph's buffer of each input tensor."""
    return Pass("network", reads=tuple(tensors.values()), writes={output: Tex("f2", 4, size=grid)},
                make=lambda device, bound: make(device, bound, network, tensors, shapes))


def make(device: Device, bound: BoundPass, network: Network, tensors: dict[str, str],
         shapes: dict[str, tuple[int, ...]]) -> Callable[[FrameState, Resources], None]:
    inputs = {t: np.empty(shape, np.float32) for t, shape in shapes.items()}

    def execute(frame: FrameState, resources: Resources) -> None:
        for tensor, name in tensors.items():
            resources.buffer(name).read_into(inputs[tensor])  # waits for the passes before
        indirect = network.run(inputs)[OUTPUT]
        pixels = np.ones((*indirect.shape[1:], 4), np.float16)
        pixels[..., :3] = np.moveaxis(indirect, 0, -1)[::-1]  # tensors are top-down, GL is bottom-up
        resources[bound.writes[0]].write(pixels.tobytes())

    return execute


