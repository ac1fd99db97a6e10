"""Packs the numbers for the whole frame that a network reads, on the CPU."""

import numpy as np

from app.arrays import F32
from app.environment import harmonics
from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.pool import Resources
from app.graph import BoundPass, Buf, Pass
from app.network.channels import ALL_BOUNCES, CHANNELS, GLOBALS
from app.network.contract import ModelContract
from app.scene import Environment


def declare(name: str, contract: ModelContract, tensors: dict[str, str], environment: Environment | None,
            bounces: int | None) -> Pass:
    """The pass ``name``.

    Parameters
    ----------
    tensors : dict of str to str
        The graph's name of each tensor.
    bounces : int or None
        Of indirect light; None requests all of them.
    """
    specs = {tensors[t]: spec for t, spec in contract.inputs.items() if spec.grid == GLOBALS}

    def values(channel: str, frame: FrameState) -> F32:
        match channel:
            case "environment.sh" if environment is not None:
                return harmonics(environment, frame.view.rotation)
            case "environment.sh":
                return np.zeros(CHANNELS[channel].components, np.float32)
            case "bounces":
                return np.array([bounces or ALL_BOUNCES], np.float32)
        raise AssertionError(channel)

    def make(device: Device, bound: BoundPass) -> Execute:
        def execute(frame: FrameState, resources: Resources) -> None:
            for tensor, spec in specs.items():
                packed = np.concatenate([values(channel, frame) for channel in spec.channels])
                resources.write_array(tensor, packed)

        return execute

    writes = {tensor: Buf(spec.shape((0, 0)), on_host=True) for tensor, spec in specs.items()}
    return Pass(name, writes=writes, make=make)
