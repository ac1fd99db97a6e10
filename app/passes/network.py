"""A network: tensors in, low-resolution light out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.pool import Resources
from app.graph import BoundPass, Buf, Pass, Resource, Tex
from app.network.channels import SEEN, SURFEL_INDIRECT

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
        writes[targets[SURFEL_INDIRECT]] = Buf((3, network.contract.surfels[0]), on_host=True)
    return Pass(name, reads=tuple(tensors.values()), writes=writes,
                make=lambda device, bound: make(device, bound, network, tensors, grid, targets))


def make(device: Device, bound: BoundPass, network: Network | RepeatedNetwork, tensors: dict[str, str],
         grid: tuple[int, int], targets: dict[str, str]) -> Execute:
    drawn = {t: np.empty(spec.shape(grid), np.float32) for t, spec in network.contract.inputs.items()
             if spec.grid in SEEN}
    written = {channel: target for channel, target in targets.items() if target in bound.writes}

    def execute(frame: FrameState, resources: Resources) -> None:
        inputs = {tensor: resources.array(name) for tensor, name in tensors.items() if tensor not in drawn}
        for tensor, pixels in drawn.items():
            resources.buffer(tensors[tensor]).read_into(pixels)  # waits for the passes before
        outputs = network.run(inputs | drawn)
        for channel, target in written.items():
            if channel == SURFEL_INDIRECT:
                resources.write_array(target, outputs[channel])
                continue
            pixels = np.ones((*outputs[channel].shape[1:], 4), np.float16)
            pixels[..., :3] = np.moveaxis(outputs[channel], 0, -1)[::-1]  # tensors are top-down, GL is bottom-up
            resources[target].write(pixels.tobytes())

    return execute
