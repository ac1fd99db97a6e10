"""The environment's light on surfels: its rays are traced once through the static body, then only where bodies move."""

from collections.abc import Sequence

import numpy as np

from app.arrays import F32, Bools, Ints
from app.environment import SKY_DISTANCE, SkyLight, sky_light
from app.raycast.caster import STATIC, AttachedPoints, Caster
from app.scene import Environment
from app.surfels.ray_bundle import SHARE, may_meet_sphere

RAYS = 144  # of a surfel, importance-sampled from the environment, the same for all; RAYS // SHARE on moving bodies


class SkyRays:
    """Shadow rays from N surfels to an environment."""

    def __init__(self, caster: Caster, surfels: AttachedPoints, environment: Environment) -> None:
        self._caster, self._surfels = caster, surfels
        self._sky, self._sky_of_moving = sky_light(environment, RAYS), sky_light(environment, RAYS // SHARE)
        is_static = surfels.anchors.body == STATIC
        self._static, self._moving = np.flatnonzero(is_static), np.flatnonzero(~is_static)
        self._open_past_static = self._trace(self._facing(self._static, self._sky), self._static, self._sky, [STATIC])

    def irradiance(self) -> F32:
        """Irradiance / π, shape (N, 3), for the bodies' current matrices, W/(sr m²)."""
        facing = self._facing(self._moving, self._sky_of_moving)
        open_to = self._trace(facing, self._moving, self._sky_of_moving, range(len(self._caster.bodies)))
        normal = self._surfels.current()[1]
        irradiance = np.empty_like(normal)
        irradiance[self._static] = self._sky.irradiance(normal[self._static], self._past_moving_bodies())
        irradiance[self._moving] = self._sky_of_moving.irradiance(normal[self._moving], open_to)
        return irradiance

    def _past_moving_bodies(self) -> Bools:
        """Which rays of surfels on the static body end nowhere."""
        moving = range(STATIC + 1, len(self._caster.bodies))
        open_to, may_meet = self._open_past_static.copy(), np.zeros_like(self._open_past_static)
        for index in moving:
            center, radius = self._caster.bounding_sphere(index)
            to = np.asarray(center - self._origins(self._static), np.float32)
            may_meet |= open_to & may_meet_sphere(to, to @ self._sky.direction.T, radius)
        open_to[may_meet] = self._trace(may_meet, self._static, self._sky, moving)[may_meet]
        return open_to

    def _facing(self, rows: Ints, sky: SkyLight) -> Bools:
        """Which rays leave the front of the surfels at an index, shape (M, K)."""
        return np.asarray(self._surfels.current()[1][rows] @ sky.direction.T > 0)

    def _origins(self, rows: Ints) -> F32:
        position, normal = self._surfels.current()
        return np.asarray(position[rows] + normal[rows] * self._caster.ray_epsilon, np.float32)

    def _trace(self, chosen: Bools, rows: Ints, sky: SkyLight, bodies: Sequence[int]) -> Bools:
        """Which of the ``chosen`` rays of the surfels at an index, shape (M, K), end nowhere on ``bodies``."""
        surfel, ray = np.nonzero(chosen)
        ends = sky.direction.take(ray, axis=0) * np.float32(SKY_DISTANCE * self._caster.extent)
        is_open = np.zeros_like(chosen)
        is_open[surfel, ray] = ~self._caster.is_occluded(self._origins(rows).take(surfel, axis=0), ends,
                                                         proxies_block=True, bodies=bodies)
        return is_open
