"""Keys, and the values between them, by glTF's three kinds of interpolation."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from app.arrays import F64

_MIN_SLERP_SINE = 1e-6  # of the angle between two quaternions; nearer ones are interpolated linearly


class Interpolation(StrEnum):
    """How values between two keys are found, by glTF's names."""

    STEP = "STEP"
    LINEAR = "LINEAR"
    CUBICSPLINE = "CUBICSPLINE"


@dataclass(frozen=True, eq=False)
class Track:
    """Keys of M vectors of W numbers that change together.

    Attributes
    ----------
    times : ndarray, float64, shape (K,)
        Seconds, increasing; the first and the last value are held outside them.
    values : ndarray, float64, shape (K, M, W), or (K, 3, M, W) for cubic splines
        The middle dimension of a spline: the tangent towards the key, the value, the tangent from it on.
    are_rotations : bool
        Whether the vectors are unit quaternions x, y, z, w.
    period : float
        Seconds after which the animation begins again; 0: never.
    """

    times: F64
    values: F64
    interpolation: Interpolation = Interpolation.LINEAR
    are_rotations: bool = False
    period: float = 0.0

    @property
    def is_constant(self) -> bool:
        """Whether no time changes any value."""
        values = self.values
        if self.interpolation is Interpolation.CUBICSPLINE:
            if self.values[:, ::2].any():
                return False
            values = self.values[:, 1]
        return bool((values == values[:1]).all())

    def at(self, time: float) -> F64:
        """The vectors at ``time`` seconds, shape (M, W)."""
        time = time % self.period if self.period > 0 else time
        right = int(np.searchsorted(self.times, time, side="right"))
        left, right = max(right - 1, 0), min(right, len(self.times) - 1)
        span = float(self.times[right] - self.times[left])
        t = min(max((time - float(self.times[left])) / span, 0.0), 1.0) if span > 0 else 0.0
        if self.interpolation is Interpolation.CUBICSPLINE:
            values = _hermite(self.values[left, 1], span * self.values[left, 2], self.values[right, 1],
                              span * self.values[right, 0], t)
        elif self.interpolation is Interpolation.STEP or t == 0:
            values = self.values[left]
        elif self.are_rotations:
            return _slerp(self.values[left], self.values[right], t)
        else:
            values = (1 - t) * self.values[left] + t * self.values[right]
        return _normalize(values) if self.are_rotations else values


def _hermite(start: F64, start_tangent: F64, end: F64, end_tangent: F64, t: float) -> F64:
    t2, t3 = t * t, t * t * t
    return ((2 * t3 - 3 * t2 + 1) * start + (t3 - 2 * t2 + t) * start_tangent
            + (3 * t2 - 2 * t3) * end + (t3 - t2) * end_tangent)


def _slerp(start: F64, end: F64, t: float) -> F64:
    """Spherical interpolation between unit quaternions, shape (M, 4), on the shorter way."""
    cosine = (start * end).sum(axis=1, keepdims=True)
    end, cosine = np.where(cosine < 0, -end, end), np.minimum(np.abs(cosine), 1.0)
    angle, sine = np.arccos(cosine), np.sqrt(1 - cosine * cosine)
    near, sine = sine < _MIN_SLERP_SINE, np.maximum(sine, _MIN_SLERP_SINE)
    a = np.where(near, 1 - t, np.sin((1 - t) * angle) / sine)
    b = np.where(near, t, np.sin(t * angle) / sine)
    return _normalize(a * start + b * end)


def _normalize(quaternions: F64) -> F64:
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    return quaternions / np.where(length > 0, length, 1.0)
