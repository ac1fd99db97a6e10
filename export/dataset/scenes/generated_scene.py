"""A scene together with where an eye may be in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.scene import Scene

F64 = NDArray[np.float64]
Rng = np.random.Generator

FRAME_SECONDS = 1 / 30  # between the frames of a pair; moving objects have keys at both


@dataclass(frozen=True, eq=False)
class GeneratedScene:
    """What a source makes.

    Attributes
    ----------
    free : ndarray, float64, shape (K, 2, 3)
        World-space boxes that eyes may be in.
    taken : ndarray, float64, shape (M, 2, 3)
        World-space boxes that they may not be in.
    """

    scene: Scene
    free: F64
    taken: F64

    def eye(self, rng: Rng) -> F64:
        """A random place for an eye, shape (3,)."""
        for _ in range(100):
            low, high = self.free[rng.integers(len(self.free))]
            point = rng.uniform(low, high)
            if not ((point > self.taken[:, 0]) & (point < self.taken[:, 1])).all(axis=1).any():
                break
        return point
