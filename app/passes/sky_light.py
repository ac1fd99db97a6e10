"""The environment as direct light: its unshadowed irradiance on any normal, and directions to trace shadow rays along."""

import math

import numpy as np

from app.arrays import F32
from app.environment import sky_light
from app.gl.frame_state import Execute, FrameState
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex
from app.network.channels import HALF_MAX
from app.scene import Environment

NORMALS = 64      # texels along the octahedral map of normals
DIRECTIONS = 512  # that shadow rays choose from


def declare(environment: Environment) -> Pass:
    """The pass; it runs once."""
    return Pass("sky_light", writes={"sky_irradiance": Tex("f2", 4, size=(NORMALS, NORMALS)),
                                     "sky_directions": Tex("f4", 4, size=(DIRECTIONS, 2))},
                make=lambda device, bound: make(bound, environment))


def make(bound: BoundPass, environment: Environment) -> Execute:
    def execute(frame: FrameState, resources: Resources) -> None:
        if resources.is_current(None):
            return
        if "sky_irradiance" in bound.writes:
            irradiance = np.minimum(_irradiance(environment), HALF_MAX)
            resources["sky_irradiance"].write(irradiance.astype(np.float16).tobytes())
        if "sky_directions" in bound.writes:
            light = sky_light(environment, DIRECTIONS)
            resources["sky_directions"].write(_as_texels(np.stack([light.direction, light.power])).tobytes())
        resources.set_current(None)

    return execute


def octahedral_directions(size: int) -> F32:
    """Unit vectors at the texel centres of an octahedral map, shape (size, size, 3), bottom row first.

    The inverse of ``octahedral_encode`` of the shaders (Cigolle et al. 2014, "A Survey of Efficient Representations for
    Independent Unit Vectors").
    """
    at = (np.arange(size, dtype=np.float32) + 0.5) / size * 2 - 1
    x, y = np.meshgrid(at, at)
    z = 1 - abs(x) - abs(y)
    folded_x, folded_y = (1 - abs(y)) * np.where(x >= 0, 1, -1), (1 - abs(x)) * np.where(y >= 0, 1, -1)
    vector = np.stack([np.where(z < 0, folded_x, x), np.where(z < 0, folded_y, y), z], axis=-1)
    return np.asarray(vector / np.linalg.norm(vector, axis=-1, keepdims=True), np.float32)


def _irradiance(environment: Environment) -> F32:
    """Unshadowed irradiance for each normal of the octahedral map, W/m², shape (NORMALS, NORMALS, 4)."""
    light = sky_light(environment, DIRECTIONS)
    normal = octahedral_directions(NORMALS).reshape(-1, 3)
    everywhere = np.ones((len(normal), DIRECTIONS), np.bool_)
    return _as_texels(math.pi * light.irradiance(normal, everywhere)).reshape(NORMALS, NORMALS, 4)


def _as_texels(rows: F32) -> F32:
    """Vectors of three as texels of four, float32, the last 0."""
    return np.concatenate([rows, np.zeros((*rows.shape[:-1], 1))], axis=-1).astype(np.float32)
