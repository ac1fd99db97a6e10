"""A network: tensors in, low-resolution light out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.pool import Resources
from app.graph import BoundPass, Buf, Pass, Resource, Tex
from app.network.channels import SURFEL_INDIRECT

if TYPE_CHECKING:
    from app.network.bounces import RepeatedNetwork
    from app.network.session import Network


def declare(name: str, network: Network | RepeatedNetwork, tensors: dict[str, str], grid: tuple[int, int],
            targets: dict[str, str]) -> Pass:
    """The pass ``name``, which runs ``network``.

    Parameters
    ----------
    tensors : dict of str to str
        The graph's buffer of each input tensor.
    targets : dict of str to str
        The texture for each output channel, or the buffer of light at surfels.
    """
    writes: dict[str, Resource] = {target: Tex("f2", 4, size=grid) for target in targets.values()}
    if SURFEL_INDIRECT in targets:
        assert network.contract.surfels is not None
        writes[targets[SURFEL_INDIRECT]] = Buf((3, network.contract.surfels[0]))
    return Pass(name, reads=tuple(tensors.values()), writes=writes,
                make=lambda device, bound: make(device, bound, network, tensors, grid, targets))


def make(device: Device, bound: BoundPass, network: Network | RepeatedNetwork, tensors: dict[str, str],
         grid: tuple[int, int], targets: dict[str, str]) -> Execute:
    inputs = {t: np.empty(spec.shape(grid), np.float32) for t, spec in network.contract.inputs.items()}
    written = {channel: target for channel, target in targets.items() if target in bound.writes}

    def execute(frame: FrameState, resources: Resources) -> None:
        for tensor, name in tensors.items():
            resources.buffer(name).read_into(inputs[tensor])  # waits for the passes before
        outputs = network.run(inputs)
        for channel, target in written.items():
            if channel == SURFEL_INDIRECT:
                resources.buffer(target).write(np.ascontiguousarray(outputs[channel], np.float32))
                continue
            pixels = np.ones((*outputs[channel].shape[1:], 4), np.float16)
            pixels[..., :3] = np.moveaxis(outputs[channel], 0, -1)[::-1]  # tensors are top-down, GL is bottom-up
            resources[target].write(pixels.tobytes())

    return execute
