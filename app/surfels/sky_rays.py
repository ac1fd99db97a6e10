"""Which parts of the environment surfels see: traced once through the static body, then only where bodies move."""

from collections.abc import Sequence

import numpy as np

from app.arrays import F32, Bools
from app.environment import SKY_DISTANCE
from app.raycast.caster import STATIC, AttachedPoints, Caster
from app.surfels.ray_bundle import SHARE, may_meet_sphere


class SkyRays:
    """Rays from N surfels along the same K directions; each surfel on a moving body traces 1/SHARE of them.

    Parameters
    ----------
    directions : ndarray, float32, shape (K, 3)
        Local space, unit length.

    Attributes
    ----------
    traced : ndarray of bool, shape (N, K)
        Which rays are traced, where they leave the front of their surfel.
    """

    def __init__(self, caster: Caster, surfels: AttachedPoints, directions: F32) -> None:
        self._caster, self._surfels, self._directions = caster, surfels, directions
        self._is_static = surfels.anchors.body == STATIC
        surfel, ray = np.ogrid[:len(self._is_static), :len(directions)]
        self.traced: Bools = self._is_static[:, None] | ((surfel + ray) % SHARE == 0)
        self._open_past_static = self._trace(self.traced & self._is_static[:, None], [STATIC])

    def open_to(self) -> Bools:
        """Which of the traced rays end nowhere, shape (N, K), for the bodies' current matrices."""
        moving = range(STATIC + 1, len(self._caster.bodies))
        seen, may_meet = self._open_past_static.copy(), np.zeros_like(self._open_past_static)
        for index in moving:
            may_meet |= seen & self._may_meet(index)
        seen[may_meet] = self._trace(may_meet, moving)[may_meet]
        return seen | self._trace(self.traced & ~self._is_static[:, None], range(STATIC, moving.stop))

    def _may_meet(self, index: int) -> Bools:
        """Whether each ray may meet body ``index``, shape (N, K)."""
        center, radius = self._caster.bounding_sphere(index)
        to = np.asarray(center - self._surfels.current()[0], np.float32)
        return may_meet_sphere(to, to @ self._directions.T, radius)

    def _trace(self, chosen: Bools, bodies: Sequence[int]) -> Bools:
        """Which of the ``chosen`` rays, shape (N, K), leave the front of their surfel and end nowhere on ``bodies``."""
        position, normal = self._surfels.current()
        surfel, ray = np.nonzero(chosen & (normal @ self._directions.T > 0))
        origins = (position + normal * self._caster.ray_epsilon).take(surfel, axis=0)
        ends = self._directions.take(ray, axis=0) * np.float32(SKY_DISTANCE * self._caster.extent)
        is_open = np.zeros_like(chosen)
        is_open[surfel, ray] = ~self._caster.is_occluded(origins, ends, proxies_block=True, bodies=bodies)
        return is_open
