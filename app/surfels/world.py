"""The surfels of a scene: where they are, what their traced rays meet, and where direct light falls on them."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.environment import sky_light
from app.math3d import View
from app.raycast.caster import Caster, Hits
from app.scene import Scene
from app.surfels import kernel
from app.surfels.attached_points import AttachedPoints
from app.surfels.farthest_points import farthest, neighbour_distance
from app.surfels.random_walks import sphere, walk
from app.surfels.ray_bundle import Bundle, cosine_rays

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Ints = NDArray[np.int64]

CANDIDATES = 8  # places that walks find, for each surfel
MAX_LIGHT_SAMPLES = 8      # of a surfel at most, whose mean is its direct light
TURN = 4.0      # a unit of normal counts like this many distances between surfels when they are spread
NEIGHBOUR = 8   # a surfel's radius reaches to this neighbour
COVERAGE_RAYS, FAR, MAX_BARE = 64, 2.0, 0.25  # rays from the eye; in radii; share that may end far from surfels
GLOW_RAYS = 144  # of a surfel towards what glows, which may be small
SKY_RAYS = 144   # of a surfel towards the environment, the same for all: most go where its light is


class WorldSurfels:
    """Points that stand for all surfaces that can exchange light with what a view sees.

    Parameters
    ----------
    view : View
        Where walks over the surfaces begin; surfels lie closest together in what it sees.
    count, rays : int
        Surfels, S, and rays of each, K.

    Attributes
    ----------
    origin : ndarray, float64, shape (3,)
        Local space's origin in world space; its axes are the world's, its unit the scene's.
    position, normal : ndarray, float32, shape (S, 3)
        Local space. There are ``used`` surfels; further rows are zeros.
    radius, weight : ndarray, float32, shape (S,)
        See ``kernel``. The weight is at most 1, less in tight corners, 0 in unused rows.
    index : ndarray, float32, shape (S, K)
        The surfel that each ray meets; -1 for none.
    albedo : ndarray, float32, shape (S, K, 3)
        At the end of each ray; 0 where it meets nothing.
    glow, sky : ndarray, float32, shape (S, 3)
        Mean radiance of what glows along the rays; irradiance / π straight from the environment; W/(sr m²).
    light_sample_position, light_sample_normal : ndarray, float32, shape (P, 3)
        Local space, sorted by surfel.
    light_sample_surfel : ndarray of int, shape (P,)
    """

    def __init__(self, scene: Scene, view: View, count: int, rays: int, time: float = 0.0) -> None:
        rng = np.random.default_rng(0)
        self._caster = Caster(scene)
        self._caster.place(time)
        self._time, self.origin = time, self._caster.origin
        self.count, self.rays = count, rays
        found = walk(self._caster, view, CANDIDATES * count, rng)
        gap = _gap(found.position, count, scene.longest_edge)
        apart = np.concatenate([found.position, TURN * gap * found.normal], axis=1)
        chosen = farthest(apart, count)
        self.used = len(chosen)
        self._surfels = AttachedPoints(self._caster, found.position[chosen], found.normal[chosen], found.body[chosen])
        self._lamp = found.lamp[chosen]
        self._fill_surfels()
        reach = neighbour_distance(apart[chosen], NEIGHBOUR)
        self.radius = self._padded(np.minimum(reach, scene.longest_edge), gap)
        self._assign_light_samples(found, chosen)
        self._rays = cosine_rays(self._caster, self._surfels, rays, rng)
        self._static_index = self._nearest(self._rays.static)
        middle = np.median(self._rays.static.distance.reshape(self.used, rays), axis=1)
        self.weight = self._padded(np.minimum(middle / self.radius[:self.used], 1.0))
        glows = any(m.emits and not m.is_light_proxy for m in scene.materials)
        self._glow_rays = cosine_rays(self._caster, self._surfels, GLOW_RAYS, rng) if glows else None
        self._sky = None
        if scene.environment is not None:
            self._sky = sky_light(scene.environment, SKY_RAYS)
            directions = np.broadcast_to(self._sky.direction, (self.used, SKY_RAYS, 3))
            self._sky_rays = Bundle(self._caster, self._surfels, directions, turning=False)
        self._trace()

    def place(self, time: float) -> bool:
        """Move what moves to where it is at ``time`` seconds, and trace again what that changes; False for nothing."""
        if time == self._time or not self._caster.dynamic_instances:
            return False
        before, self._time = self._caster.matrices, time
        self._caster.place(time)
        if np.array_equal(before, self._caster.matrices):
            return False
        self._fill_surfels()
        self.light_sample_position, self.light_sample_normal = self._places.now()
        self._trace()
        return True

    def covers(self, eye: F64) -> bool:
        """Whether most of what surrounds ``eye`` (world space, shape (3,)) has surfels."""
        origins = np.broadcast_to((eye - self.origin).astype(np.float32), (COVERAGE_RAYS, 3))
        hits = self._caster.cast(origins, sphere(np.random.default_rng(0), COVERAGE_RAYS))
        hits = hits.rows(hits.body >= 0)
        surfel = self._nearest(hits)
        away = np.linalg.norm(hits.position - self.position[surfel], axis=1)
        behind = (hits.normal * self.normal[surfel]).sum(axis=1) < 0  # of a wall between two rooms
        bare = (surfel < 0) | (away > FAR * self.radius[surfel]) | behind
        return not bare.any() or float(bare.mean()) < MAX_BARE

    def _fill_surfels(self) -> None:
        position, normal = self._surfels.now()
        self.position, self.normal = self._padded(position), self._padded(normal)

    def _assign_light_samples(self, found: Hits, chosen: Ints) -> None:
        """Give each candidate to the surfel that weighs most there, at most ``MAX_LIGHT_SAMPLES`` to one; none on lamps.

        Rounding alone decides on which side of itself a light would shine.
        """
        surfel = self._nearest(found)
        surfel[chosen] = np.arange(self.used)
        order = np.argsort(surfel, kind="stable")
        order = order[(surfel[order] >= 0) & ~found.lamp[order]]
        kept = order[np.arange(len(order)) - np.searchsorted(surfel[order], surfel[order]) < MAX_LIGHT_SAMPLES]
        self.light_sample_surfel = surfel[kept]
        self._places = AttachedPoints(self._caster, found.position[kept], found.normal[kept], found.body[kept])
        self.light_sample_position, self.light_sample_normal = self._places.now()

    def _trace(self) -> None:
        moved = self._rays.moved()
        index, albedo = self._static_index.copy(), self._rays.static.albedo.copy()
        index[moved.ray], albedo[moved.ray] = self._nearest(moved.hits)[moved.hit], moved.hits.albedo[moved.hit]
        albedo[index < 0] = 0.0
        self.index = self._padded(index.reshape(self.used, self.rays), -1)
        self.albedo = self._padded(albedo.reshape(self.used, self.rays, 3))
        self.glow, self.sky = self._padded(self._glow_of_meshes()), self._padded(self._light_of_sky())

    def _glow_of_meshes(self) -> F32:
        """Shape (used, 3)."""
        if self._glow_rays is None:
            return np.zeros((self.used, 3), np.float32)
        moved, glow = self._glow_rays.moved(), self._glow_rays.static.emission.copy()
        glow[moved.ray] = moved.hits.emission[moved.hit]
        return np.asarray(glow.reshape(self.used, GLOW_RAYS, 3).mean(axis=1))

    def _light_of_sky(self) -> F32:
        """Irradiance / π, shape (used, 3)."""
        if self._sky is None:
            return np.zeros((self.used, 3), np.float32)
        moved, free = self._sky_rays.moved(), self._sky_rays.static.body < 0
        free[moved.ray] = moved.hits.body[moved.hit] < 0
        return self._sky.irradiance(self._surfels.now()[1], free.reshape(self.used, SKY_RAYS))

    def _nearest(self, hits: Hits) -> Ints:
        """The surfel that weighs most at each hit, of the same body if it has any; -1 for the sky.

        What lies close behind a lamp may be very bright, and is not seen: lamps have surfels of their own, or none.
        """
        found = np.full(len(hits.body), -1, np.int64)
        middle = self.position[:max(self.used, 1)].mean(axis=0)  # for precision where the scene is much larger
        for body, lamp in product(range(len(self._caster.bodies)), (False, True)):
            mine = np.flatnonzero((self._surfels.body == body) & (self._lamp == lamp))
            rows = np.flatnonzero((hits.body == body) & (hits.lamp == lamp))
            if len(mine) == 0 and not lamp:  # too small, or not there when surfels were made
                mine = np.flatnonzero(~self._lamp)
            if len(mine) and len(rows):
                key = kernel.keys(self.position[mine] - middle, self.normal[mine], self.radius[mine])
                found[rows] = mine[kernel.nearest(key, hits.position[rows] - middle, hits.normal[rows])]
        return found

    def _padded(self, rows: NDArray[Any], fill: float = 0.0) -> F32:
        """``count`` rows of float32, of which ``rows`` are the first."""
        padded = np.full((self.count, *rows.shape[1:]), fill, np.float32)
        padded[:len(rows)] = rows
        return padded


def _gap(positions: F32, count: int, extent: float) -> float:
    """About how far ``count`` surfels spread over ``positions`` will lie apart, in scene units."""
    some = positions[:: max(1, len(positions) // max(count, 1))]
    nearest = neighbour_distance(some, 1)
    return float(2 * np.median(nearest)) if len(some) > 1 else extent
