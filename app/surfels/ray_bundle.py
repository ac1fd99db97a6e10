"""The rays of all surfels, traced once through what stands still, and each frame only where things move."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.raycast.caster import STATIC, Caster, Hits, joined
from app.surfels.attached_points import AttachedPoints
from app.surfels.random_walks import hemisphere

F32 = NDArray[np.float32]
Ints = NDArray[np.int64]

ROUNDING = 1e-5  # of squared distances in single precision, and some
SHARE = 4  # a surfel that rides traces one in so many of its rays, each of which counts as often


@dataclass(frozen=True, eq=False)
class Moved:
    """Rays that end elsewhere than on what stands still.

    Attributes
    ----------
    ray : ndarray of int, shape (M,)
        Numbers of the rays.
    hits : Hits
    hit : ndarray of int, shape (M,)
        Which of the hits is the end of each ray.
    """

    ray: Ints
    hits: Hits
    hit: Ints


class Bundle:
    """As many rays from each surfel.

    Parameters
    ----------
    directions : ndarray, float32, shape (N, K, 3)
        Local space, of unit length.
    turning : bool
        Whether a surfel's rays turn with its body.
    traced : int or None
        Where a surfel rides on a moving body, so many of its first rays are traced and stand for the others; all of
        them without.

    Attributes
    ----------
    still : Hits
        Where the rays, N · K sorted by surfel, end on what stands still.
    """

    def __init__(self, caster: Caster, surfels: AttachedPoints, directions: F32, turning: bool = True,
                 traced: int | None = None) -> None:
        rays = directions.shape[1]
        self._caster, self._surfels, self._rays, self._traced = caster, surfels, rays, traced or rays
        position, normal = surfels.now()
        origins = position + normal * caster.ray_epsilon
        self.static = caster.cast(np.repeat(origins, rays, axis=0), directions.reshape(-1, 3), (STATIC,))
        self._static, self._dynamic = np.flatnonzero(surfels.body == STATIC), np.flatnonzero(surfels.body != STATIC)
        self._origins, self._directions = origins[self._static], directions[self._static]
        dynamic = directions[self._dynamic, :self._traced].reshape(-1, 3)
        body = np.repeat(surfels.body[self._dynamic] if turning else np.full(len(self._dynamic), STATIC), self._traced)
        self._carried = AttachedPoints(caster, np.zeros_like(dynamic), dynamic, body)

    def moved(self) -> Moved:
        """Rays whose ends depend on what moves, while the bodies are where they are now."""
        standing, before = self._before()
        position, normal = self._surfels.now()
        origins = (position + normal * self._caster.ray_epsilon)[self._dynamic]
        ends = self._caster.cast(np.repeat(origins, self._traced, axis=0), self._carried.now()[1])
        ray = np.arange(self._rays)
        dynamic = (self._dynamic[:, None] * self._rays + ray).ravel()
        hit = (np.arange(len(self._dynamic))[:, None] * self._traced + ray % self._traced).ravel()
        return Moved(np.concatenate([standing, dynamic]), joined([before, ends]),
                     np.concatenate([np.arange(len(standing)), len(standing) + hit]))

    def _before(self) -> tuple[Ints, Hits]:
        """Rays of standing surfels that meet a moving body before what stands still, and where."""
        distance = self.static.distance.reshape(-1, self._rays)[self._static]
        near = np.zeros(distance.shape, bool)
        moving = tuple(range(1, len(self._caster.bodies)))
        for index in moving:
            near |= self._meets_ball(*self._caster.ball(index), distance)
        surfel, ray = np.nonzero(near)
        hits = self._caster.cast(self._origins[surfel], self._directions[surfel, ray], moving, distance[near])
        met = hits.body >= 0
        return (self._static[surfel] * self._rays + ray)[met], hits.rows(met)

    def _meets_ball(self, centre: F32, radius: float, distance: F32) -> NDArray[np.bool_]:
        """Rays of standing surfels, shape (N, K), that may meet a ball before ``distance``."""
        to = centre - self._origins
        along = (self._directions @ to[:, :, None])[..., 0]
        off = (to**2).sum(axis=1, keepdims=True) - along**2
        least = radius**2 + ROUNDING * (to**2).sum(axis=1, keepdims=True)
        return np.asarray((off <= least) & (along > -radius) & (along - radius <= distance))


def cosine_rays(caster: Caster, surfels: AttachedPoints, rays: int, rng: np.random.Generator) -> Bundle:
    """``rays`` of each surfel, a square number, spread as the cosine to its normal."""
    normal = surfels.now()[1]
    traced = rays // SHARE if math.isqrt(rays) % SHARE == 0 else rays  # see _squares
    return Bundle(caster, surfels, hemisphere(normal, _squares(rng, len(normal), rays)), traced=traced)


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
