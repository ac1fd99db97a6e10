"""Points that ride on the bodies of a scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from app.math3d import affine_inverse
from app.raycast.caster import STATIC, Caster, turned

F32 = NDArray[np.float32]
Ints = NDArray[np.int64]


class AttachedPoints:
    """Points noted in their bodies' space.

    Parameters
    ----------
    position, normal : ndarray, float32, shape (N, 3)
        Local space, where ``caster`` has the bodies now.
    body : ndarray of int, shape (N,)
    """

    def __init__(self, caster: Caster, position: F32, normal: F32, body: Ints) -> None:
        self._caster, self.body = caster, body
        self._rest = self._through(position, normal, [affine_inverse(m) for m in caster.matrices])

    def now(self) -> tuple[F32, F32]:
        """Positions and normals in local space, where the bodies are now."""
        return self._through(*self._rest, self._caster.matrices)

    def _through(self, position: F32, normal: F32, matrices: Sequence[NDArray[np.float64] | None]) -> tuple[F32, F32]:
        position, normal = position.copy(), normal.copy()
        for index, matrix in enumerate(matrices):
            rows = self.body == index
            if index != STATIC and matrix is not None and rows.any():
                position[rows] = position[rows] @ matrix[:3, :3].T + matrix[:3, 3]
                normal[rows] = turned(normal[rows], matrix)
        return position, normal
