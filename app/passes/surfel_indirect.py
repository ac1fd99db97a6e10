"""Indirect light at world surfels, by the network that lets them light each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.pool import Resources
from app.graph import BoundPass, Buf, Pass
from app.network.channels import SCREEN, SURFEL_INDIRECT
from app.surfels.tracked import TrackedSurfels

if TYPE_CHECKING:
    from app.network.session import Network


def declare(network: Network, tensors: dict[str, str], surfels: TrackedSurfels) -> Pass:
    """Runs ``network``, opened for a screen of one texel, which stays empty.

    Parameters
    ----------
    tensors : dict of str to str
        The graph's buffer of each input tensor that is not on the screen.
    """
    assert network.contract.surfels is not None
    return Pass("surfel_indirect", reads=(*tensors.values(), "surfel_light"),
                writes={"surfel_indirect": Buf((3, network.contract.surfels[0]), on_host=True)},
                make=lambda device, bound: make(device, bound, network, tensors, surfels))


def make(device: Device, bound: BoundPass, network: Network, tensors: dict[str, str],
         surfels: TrackedSurfels) -> Execute:
    empty = {t: np.zeros(spec.shape((1, 1)), np.float32) for t, spec in network.contract.inputs.items()
             if t not in tensors}
    assert all(network.contract.inputs[t].grid == SCREEN for t in empty)

    def execute(frame: FrameState, resources: Resources) -> None:
        key = surfels.version, resources.read_stamps("surfel_light")  # the view moves surfels, and changes no light
        if not frame.stands_alone and resources.is_current(key):
            return
        inputs = empty | {tensor: resources.array(name) for tensor, name in tensors.items()}
        resources.write_array("surfel_indirect", network.run(inputs)[SURFEL_INDIRECT])
        resources.set_current(key)

    return execute
