"""The rays of all surfels, traced once through what stands still and again only where things move."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from app.surfels.carried import Carried
from app.surfels.caster import STILL, Caster, Hits
from app.surfels.walk import hemisphere

F32 = NDArray[np.float32]


class Bundle:
    """As many rays from each surfel, spread as the cosine to its normal.

    Parameters
    ----------
    rays : int
        Of a surfel, K; a square number.
    """

    def __init__(self, caster: Caster, surfels: Carried, rays: int, rng: np.random.Generator) -> None:
        self._caster, self._surfels = caster, surfels
        _, normal = surfels.now()
        directions = hemisphere(normal, _squares(rng, len(normal), rays))
        self._body = np.repeat(surfels.body, rays)
        nowhere = np.zeros((len(self._body), 3), np.float32)
        self._directions = Carried(caster, nowhere, directions.reshape(-1, 3), self._body)
        self._rays = rays
        self._still = self._cast(np.flatnonzero(self._body == STILL), (STILL,))

    def trace(self) -> Hits:
        """Where the rays end while the bodies are where they are now; N · K rows, sorted by surfel."""
        if len(self._caster.bodies) == 1:
            return self._still
        moving = tuple(range(1, len(self._caster.bodies)))
        rows = np.flatnonzero(self._body == STILL)
        before = self._cast(rows, moving, self._still.distance)
        stands = before.body < 0
        found = [np.where(stands.reshape(-1, *[1] * (a.ndim - 1)), a, b)
                 for a, b in zip(self._still.arrays(), before.arrays(), strict=True)]
        riding = np.flatnonzero(self._body != STILL)
        merged = []
        for a, b in zip(found, self._cast(riding).arrays(), strict=True):
            both = np.empty((len(self._body), *a.shape[1:]), a.dtype)
            both[rows], both[riding] = a, b
            merged.append(both)
        return Hits(*merged)

    def _cast(self, rows: NDArray[np.int64], bodies: tuple[int, ...] | None = None, most: F32 | None = None) -> Hits:
        position, normal = self._surfels.now()
        of = rows // self._rays
        origins = position[of] + normal[of] * self._caster.skin
        return self._caster.cast(origins, self._directions.now()[1][rows], bodies, most)


def _squares(rng: np.random.Generator, count: int, rays: int) -> NDArray[np.float64]:
    """Random numbers, shape (count, rays, 2), one in each square of a grid on [0, 1)².

    Each quarter of them has one in each square of a grid half as fine where the grid's side is a multiple of 4.
    """
    side = math.isqrt(rays)
    assert side * side == rays, "rays on a square grid"
    y, x = np.divmod(np.arange(rays), side)
    # Which of four neighbouring squares a quarter takes alternates, or it would lean to one side.
    order = np.lexsort((x, y, (x + y // 2) % 2, (y + x // 2) % 2)) if side % 2 == 0 else np.arange(rays)
    square = np.stack([x, y], axis=-1)[order]
    return (square + rng.random((count, rays, 2))) / side
