"""Packs what a network reads of the environment as a vector: its spherical harmonics, on the CPU."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from app.channels import CHANNELS, VECTOR
from app.contract import ModelContract
from app.environment import harmonics
from app.gl.context import Device
from app.gl.frame_state import FrameState
from app.gl.pool import Resources
from app.graph import BoundPass, Buf, Pass
from app.scene import Environment


def declare(contract: ModelContract, names: dict[str, str], environment: Environment | None, scale: float,
            name: str = "harmonics") -> Pass:
    """``names`` gives the graph's name of each tensor; radiance is multiplied by ``scale``, the scene's."""
    specs = {names[t]: spec for t, spec in contract.inputs.items() if spec.grid == VECTOR}

    def make(device: Device, bound: BoundPass) -> Callable[[FrameState, Resources], None]:
        def execute(frame: FrameState, resources: Resources) -> None:
            values = {"environment.sh": np.zeros(CHANNELS["environment.sh"].components, np.float32)}
            if environment is not None:
                values["environment.sh"] = scale * harmonics(environment, frame.view.rotation)
            for tensor, spec in specs.items():
                packed = np.concatenate([values[channel] for channel in spec.channels])
                resources.buffer(tensor).write(packed.astype(np.float32))

        return execute

    return Pass(name, writes={tensor: Buf(spec.shape((0, 0))) for tensor, spec in specs.items()}, make=make)
