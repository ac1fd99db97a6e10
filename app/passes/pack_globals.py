"""Packs the numbers for the whole frame that a network reads as vectors, on the CPU."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from app.environment import harmonics
from app.gl.context import Device
from app.gl.frame_state import FrameState
from app.gl.pool import Resources
from app.graph import BoundPass, Buf, Pass
from app.network.channels import ALL_BOUNCES, CHANNELS, GLOBALS
from app.network.contract import ModelContract
from app.scene import Environment


def declare(contract: ModelContract, names: dict[str, str], environment: Environment | None, scale: float,
            bounces: int | None, name: str = "pack_globals") -> Pass:
    """``names`` gives the graph's name of each tensor; radiance is multiplied by ``scale``, the scene's.

    Without a number of ``bounces`` all of them are asked for.
    """
    specs = {names[t]: spec for t, spec in contract.inputs.items() if spec.grid == GLOBALS}

    def values(channel: str, frame: FrameState) -> NDArray[np.float32]:
        match channel:
            case "environment.sh" if environment is not None:
                return np.float32(scale) * harmonics(environment, frame.view.rotation)
            case "environment.sh":
                return np.zeros(CHANNELS[channel].components, np.float32)
            case "bounces":
                return np.array([bounces or ALL_BOUNCES], np.float32)
        raise AssertionError(channel)

    def make(device: Device, bound: BoundPass) -> Callable[[FrameState, Resources], None]:
        def execute(frame: FrameState, resources: Resources) -> None:
            for tensor, spec in specs.items():
                resources.buffer(tensor).write(np.concatenate([values(channel, frame) for channel in spec.channels]))

        return execute

    return Pass(name, writes={tensor: Buf(spec.shape((0, 0))) for tensor, spec in specs.items()}, make=make)
