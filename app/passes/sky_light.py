"""The environment as direct light: unshadowed irradiance by normal, and parts for shadow rays."""

import numpy as np

from app.arrays import F32
from app.environment import STRATA, radiance_along, sky_light, sky_strata
from app.gl.frame_state import Execute, FrameState
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex
from app.network.channels import HALF_MAX
from app.scene import Environment

NORMALS = 64      # texels along the octahedral map of normals
LEVELS = 6        # of roughness, from 0 to 1


def declare(environment: Environment) -> Pass:
    """The pass; it runs once."""
    return Pass("sky_light", writes={"sky_irradiance": Tex("f2", 4, size=(NORMALS, NORMALS)),
                                     "sky_specular": Tex("f2", 4, size=(LEVELS * NORMALS, NORMALS)),
                                     "sky_strata": Tex("f4", 4, size=(STRATA[1], 2 * STRATA[0]))},
                make=lambda device, bound: make(bound, environment))


def make(bound: BoundPass, environment: Environment) -> Execute:
    def execute(frame: FrameState, resources: Resources) -> None:
        if resources.is_current(None):
            return
        if "sky_irradiance" in bound.writes:
            irradiance = np.minimum(_irradiance(environment), HALF_MAX)
            resources["sky_irradiance"].write(irradiance.astype(np.float16).tobytes())
        if "sky_specular" in bound.writes:
            radiance = np.minimum(_prefiltered(environment), HALF_MAX)
            resources["sky_specular"].write(radiance.astype(np.float16).tobytes())
        if "sky_strata" in bound.writes:
            corner, power = sky_strata(environment)
            resources["sky_strata"].write(np.concatenate([_as_texels(corner), _as_texels(power)]).tobytes())
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
    normal = octahedral_directions(NORMALS).reshape(-1, 3)
    return _as_texels(sky_light(environment, 1).unoccluded(normal)).reshape(NORMALS, NORMALS, 4)


def _prefiltered(environment: Environment) -> F32:
    """Mean radiance within GGX lobes around each direction, a map for each roughness, (NORMALS, LEVELS · NORMALS, 4).

    As if seen along the normal (Karis 2013, "Real Shading in Unreal Engine 4"): radiance is weighted by n·l and by the
    density of l = the mirrored n, D(n·h) / 4.
    """
    direction = octahedral_directions(NORMALS).reshape(-1, 3)
    light = sky_light(environment, 1)
    n_l = np.maximum(direction @ light.cell.T, 0)
    maps = [radiance_along(environment, direction.astype(np.float64))]
    for level in range(1, LEVELS):
        alpha2 = np.float32((level / (LEVELS - 1)) ** 4)
        weight = n_l / ((0.5 + 0.5 * n_l) * (alpha2 - 1) + 1) ** 2  # n·h² is (1 + n·l) / 2
        maps.append(weight @ light.cell_power / np.maximum(weight @ light.cell_solid_angle, 1e-30)[:, None])
    return _as_texels(np.concatenate([m.reshape(NORMALS, NORMALS, 3) for m in maps], axis=1))


def _as_texels(rows: F32) -> F32:
    """Vectors of two or three numbers as texels of four, float32, zeros in the others."""
    texels = np.zeros((*rows.shape[:-1], 4), np.float32)
    texels[..., :rows.shape[-1]] = rows
    return texels
