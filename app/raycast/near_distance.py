"""How far away what surrounds an eye is."""

import math
from collections.abc import Callable

import numpy as np

from app.arrays import F64
from app.math3d import fibonacci_sphere
from app.raycast.caster import STATIC, Caster

DIRECTIONS = fibonacci_sphere(256).astype(np.float32)
NEAR_SHARE = 0.5  # of what surrounds an eye is near


class NearDistance:
    """Tells how far away what is near an eye is, by rays in all directions to what never moves.

    Surfaces that light passes count like all others.

    Parameters
    ----------
    caster : callable
        Gives the caster of the scene; called with the first eye.
    """

    def __init__(self, caster: Callable[[], Caster]) -> None:
        self._caster = caster
        self._eye, self._distance = b"", math.inf

    def __call__(self, eye: F64) -> float:
        """Distance from a world-space point within which ``NEAR_SHARE`` of all hits lie; infinite if there are none."""
        if eye.tobytes() != self._eye:
            self._eye, self._distance = eye.tobytes(), self._measure(eye)
        return self._distance

    def _measure(self, eye: F64) -> float:
        caster = self._caster()
        with np.errstate(over="ignore", invalid="ignore"):
            origins = np.broadcast_to((eye - caster.origin).astype(np.float32), DIRECTIONS.shape)
        if not np.isfinite(origins).all():
            return math.inf
        reach = np.full(len(DIRECTIONS), np.inf, np.float32)
        distance, triangle, *_ = caster.bodies[STATIC].cast(origins, DIRECTIONS, reach)
        hits = np.sort(distance[triangle >= 0])
        return float(hits[int(NEAR_SHARE * len(hits))]) if len(hits) else math.inf
