"""The rays of all surfels: traced once through the static body, and in each frame only where bodies move."""

import math
from dataclasses import dataclass

import numpy as np

from app.arrays import F32, F64, Bools, Ints
from app.math3d import row_dots
from app.raycast.caster import STATIC, AttachedPoints, Caster, Hits, concatenate
from app.surfels.random_walks import sample_cosine_hemisphere

ROUNDING = 1e-5  # margin for float32 squared distances, relative
SHARE = 4        # surfels on moving bodies trace 1/SHARE of their rays, each weighted SHARE times


@dataclass(frozen=True, eq=False)
class ChangedRays:
    """Rays that do not end where the static body alone would stop them.

    Attributes
    ----------
    ray : ndarray of int, shape (M,)
        Indices of the rays.
    hits : Hits
    hit : ndarray of int, shape (M,)
        Index into ``hits`` of each ray's end.
    """

    ray: Ints
    hits: Hits
    hit: Ints


class RayBundle:
    """K rays from each of N surfels.

    Parameters
    ----------
    directions : ndarray, float32, shape (N, K, 3)
        Local space, unit length.
    traced : int, optional
        How many rays of a surfel on a moving body are traced, the first ones; each of the others repeats one of them.
        Default all.

    Attributes
    ----------
    static : Hits
        Where the rays, N · K sorted by surfel, end on the static body.
    """

    def __init__(self, caster: Caster, surfels: AttachedPoints, directions: F32, traced: int | None = None) -> None:
        rays = directions.shape[1]
        self._caster, self._surfels, self._rays, self._traced = caster, surfels, rays, traced or rays
        position, normal = surfels.current()
        origins = position + normal * caster.ray_epsilon
        self.static = caster.cast(np.repeat(origins, rays, axis=0), directions.reshape(-1, 3), (STATIC,))
        is_static = surfels.anchors.body == STATIC
        self._static, self._dynamic = np.flatnonzero(is_static), np.flatnonzero(~is_static)
        self._origins, self._directions = origins[self._static], directions[self._static]
        self._components = np.ascontiguousarray(np.moveaxis(self._directions, 2, 0))  # multiplied several times as fast
        dynamic = directions[self._dynamic, :self._traced].reshape(-1, 3)
        anchors = surfels.anchors.select(np.repeat(self._dynamic, self._traced))
        self._dynamic_rays = AttachedPoints(caster, np.zeros_like(dynamic), dynamic, anchors)

    def trace_changes(self) -> ChangedRays:
        """Trace the rays whose ends depend on moving bodies, for the bodies' current matrices."""
        from_static, first = self._trace_from_static()
        position, normal = self._surfels.current()
        origins = (position + normal * self._caster.ray_epsilon)[self._dynamic]
        second = self._caster.cast(np.repeat(origins, self._traced, axis=0), self._dynamic_rays.current()[1])
        ray = np.arange(self._rays)
        from_dynamic = (self._dynamic[:, None] * self._rays + ray).ravel()
        hit = (np.arange(len(self._dynamic))[:, None] * self._traced + ray % self._traced).ravel()
        return ChangedRays(np.concatenate([from_static, from_dynamic]), concatenate([first, second]),
                           np.concatenate([np.arange(len(from_static)), len(from_static) + hit]))

    def _trace_from_static(self) -> tuple[Ints, Hits]:
        """Rays of static surfels that meet a moving body before the static one, and their hits."""
        distance = self.static.distance.reshape(-1, self._rays)[self._static]
        candidate = np.zeros(distance.shape, bool)
        moving = range(1, len(self._caster.bodies))
        for index in moving:
            candidate |= self._may_meet_sphere(*self._caster.bounding_sphere(index), distance)
        rays = np.flatnonzero(candidate)
        surfel, ray = np.divmod(rays, self._rays)
        hits = self._caster.cast(self._origins.take(surfel, axis=0), self._directions.reshape(-1, 3).take(rays, axis=0),
                                 moving, distance.ravel().take(rays))
        met = hits.body >= 0
        return (self._static[surfel] * self._rays + ray)[met], hits.select(met)

    def _may_meet_sphere(self, center: F32, radius: float, distance: F32) -> Bools:
        """Whether rays of static surfels may meet a sphere before ``distance``, shape (N, K)."""
        to = center - self._origins
        x, y, z = (component * toward[:, None] for component, toward in zip(self._components, to.T, strict=True))
        along = x + y + z
        return may_meet_sphere(to, along, radius) & (along - radius <= distance)


def may_meet_sphere(to: F32, along: F32, radius: float) -> Bools:
    """Whether each of the K rays from N points may meet a sphere, shape (N, K).

    Parameters
    ----------
    to : ndarray, float32, shape (N, 3)
        From the points to the sphere's centre.
    along : ndarray, float32, shape (N, K)
        Dot products of ``to`` and the rays' unit directions.
    """
    square = row_dots(to, to)[:, None]
    return np.asarray((square - along * along <= radius**2 + ROUNDING * square) & (along > -radius))


def trace_cosine_rays(caster: Caster, surfels: AttachedPoints, rays: int, rng: np.random.Generator) -> RayBundle:
    """Trace ``rays`` cosine-distributed rays of each surfel, a square number."""
    normal = surfels.current()[1]
    traced = rays // SHARE if math.isqrt(rays) % SHARE == 0 else rays  # see _stratify
    directions = sample_cosine_hemisphere(normal, _stratify(rng, len(normal), rays))
    return RayBundle(caster, surfels, directions, traced=traced)


def _stratify(rng: np.random.Generator, count: int, rays: int) -> F64:
    """Stratified random numbers, shape (count, rays, 2): one in each cell of a square grid on [0, 1)².

    Where the grid's side is a multiple of 4, each quarter of them has one in each cell of a grid half as fine.
    """
    side = math.isqrt(rays)
    assert side * side == rays, "rays on a square grid"
    y, x = np.divmod(np.arange(rays), side)
    # Which of four neighbouring cells a quarter takes alternates; otherwise its mean would be biased to one side.
    order = np.lexsort((x, y, (x + y // 2) % 2, (y + x // 2) % 2)) if side % 2 == 0 else np.arange(rays)
    cell = np.stack([x, y], axis=-1)[order]
    return (cell + rng.random((count, rays, 2))) / side
