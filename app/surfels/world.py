"""The surfels of a scene: where they are, what their rays meet, and where direct light is sampled on them."""

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.arrays import F32, F64, Ints
from app.math3d import View, put_rows, row_dots
from app.radiance_scale import reflected_radiance
from app.raycast.caster import STATIC, AttachedPoints, Caster, Hits, concatenate
from app.scene import Scene
from app.surfels import kernel, neighbours
from app.surfels.clip_planes import find_clip_planes
from app.surfels.farthest_points import neighbour_distance, sample_farthest
from app.surfels.random_walks import sample_sphere, trace_walks
from app.surfels.ray_bundle import RayBundle, trace_cosine_rays
from app.surfels.sky_rays import SkyRays

CANDIDATES = 8             # hits of random walks for each surfel
MAX_LIGHT_SAMPLES = 16     # of a surfel, whose mean is its direct light;
MAX_END_SAMPLES = 12       # of these are ends of other surfels' rays, the others candidates
MIN_SAMPLED_RADII = 2.0    # length of these rays, in radii of the surfel where they start
MIN_SAMPLE_COSINE = 0.25   # between the normals of a light sample and its surfel
NORMAL_SPACING = 4.0       # surfel spacings that a unit of difference between normals counts as in the choice
RADIUS_NEIGHBOUR = 8       # a surfel's radius is the distance to this neighbour
COVERAGE_RAYS = 64         # rays from an eye; it is covered when few of them
MAX_COVERED_RADII = 2.0    # end farther than this many radii from a surfel:
MAX_UNCOVERED = 0.25       # less than this share.
EMISSION_RAYS = 144        # of a surfel, to find emissive surfaces, which may be small
LAMP_WEIGHT = 1e-3         # of surfels on lamps: things right before one would get the light that arrives there


class WorldSurfels:
    """Points that represent all surfaces that can exchange light with what a view sees.

    Parameters
    ----------
    caster : Caster
        Of the scene; may be shared, and is moved to the time of each call.
    views : sequence of View
        Where the walks over the surfaces start; surfels are densest in what they see.
    count, rays : int
        Number of surfels, S, and of rays of each, K.
    time : float
        Seconds.

    Attributes
    ----------
    origin : ndarray, float64, shape (3,)
        Local space's origin in world space; its axes are the world's, its unit the scene's.
    used : int
        Number of surfels; rows from here on are unused.
    position, normal : ndarray, float32, shape (S, 3)
        Local space; zeros in unused rows.
    radius, weight : ndarray, float32, shape (S,)
        See ``kernel``. The weight is at most 1, less in tight corners, 0 in unused rows.
    clip_plane : ndarray, float32, shape (S, 4)
        See ``clip_planes``.
    index : ndarray, float32, shape (S, K)
        The surfel that each ray meets; -1 for none.
    albedo : ndarray, float32, shape (S, K, 3)
        At the end of each ray; 0 where it meets nothing.
    emissive_irradiance, sky_irradiance : ndarray, float32, shape (S, 3)
        Irradiance / π directly from emissive surfaces and from the environment, W/(sr m²).
    proxy_irradiance : ndarray, float32, shape (S, 3)
        Irradiance / π from light proxies on surfels that are on light proxies, W/(sr m²); 0 on others.
    light_sample_position, light_sample_normal : ndarray, float32, shape (P, 3)
        Points where direct light is sampled, in local space, sorted by surfel.
    light_sample_surfel : ndarray of int, shape (P,)
    """

    def __init__(self, scene: Scene, caster: Caster, views: Sequence[View], count: int, rays: int,
                 time: float = 0.0) -> None:
        rng = np.random.default_rng(0)
        self._caster = caster
        caster.move_to(time)
        self._revision, self.origin = caster.revision, caster.origin
        self.count, self.rays = count, rays
        candidates = trace_walks(self._caster, views, CANDIDATES * count, rng)
        spacing = _estimate_spacing(candidates.position, count, scene.longest_edge)
        features = np.concatenate([candidates.position, NORMAL_SPACING * spacing * candidates.normal], axis=1)
        chosen = sample_farthest(features, count)
        self.used = len(chosen)
        surfels = candidates.select(chosen)
        self._surfels = AttachedPoints(self._caster, surfels.position, surfels.normal, surfels.anchors)
        self._is_light_proxy = surfels.is_light_proxy
        self._update_positions()
        radius = neighbour_distance(features[chosen], RADIUS_NEIGHBOUR)
        self.radius = self._pad(np.minimum(radius, scene.longest_edge), spacing)
        self._rays = trace_cosine_rays(self._caster, self._surfels, rays, rng)
        median = np.median(self._rays.static.distance.reshape(self.used, rays), axis=1)
        weight = np.minimum(median / self.radius[:self.used], 1.0)
        is_lamp = self._is_light_proxy & (surfels.emission.max(axis=1) > reflected_radiance(scene))
        self.weight = self._pad(np.where(is_lamp, np.float32(LAMP_WEIGHT) * weight, weight))
        self.clip_plane = self._find_clip_planes(median)
        self._static_index = self._nearest(self._rays.static)
        self._assign_light_samples(candidates, chosen)
        emissive = any(m.emits and not m.is_light_proxy for m in scene.materials)
        self._emission_rays = trace_cosine_rays(self._caster, self._surfels, EMISSION_RAYS, rng) if emissive else None
        on_proxies = self._surfels.select(np.flatnonzero(self._is_light_proxy))
        self._proxy_rays = trace_cosine_rays(self._caster, on_proxies, EMISSION_RAYS, rng)
        sky = scene.environment
        self._sky_rays = None if sky is None else SkyRays(self._caster, self._surfels, sky)
        self._trace()

    def move_to(self, time: float) -> bool:
        """Move bodies and surfels to ``time`` seconds and trace the rays that this changes; False if nothing moved."""
        self._caster.move_to(time)
        if self._revision == self._caster.revision:
            return False
        self._revision = self._caster.revision
        self._update_positions()
        self.light_sample_position, self.light_sample_normal = self._light_samples.current()
        self._trace()
        return True

    def covers(self, eye: F64) -> bool:
        """Whether most surfaces seen from ``eye`` (world space, shape (3,)) have a surfel nearby."""
        origins = np.broadcast_to((eye - self.origin).astype(np.float32), (COVERAGE_RAYS, 3))
        hits = self._caster.cast(origins, sample_sphere(np.random.default_rng(0), COVERAGE_RAYS))
        hits = hits.select(hits.body >= 0)
        surfel = self._nearest(hits)
        distance = np.linalg.norm(hits.position - self.position[surfel], axis=1)
        other_side = (hits.normal * self.normal[surfel]).sum(axis=1) < 0  # of a wall between two rooms
        uncovered = (surfel < 0) | (distance > MAX_COVERED_RADII * self.radius[surfel]) | other_side
        return not uncovered.any() or float(uncovered.mean()) < MAX_UNCOVERED

    @property
    def median_radius(self) -> np.float32:
        """Median radius of the surfels in scene units."""
        return np.float32(np.median(self.radius[:max(self.used, 1)]))

    def _update_positions(self) -> None:
        position, normal = self._surfels.current()
        self.position, self.normal = self._pad(position), self._pad(normal)

    def _assign_light_samples(self, candidates: Hits, chosen: Ints) -> None:
        """Give each surfel ends of rays that meet it, at most ``MAX_END_SAMPLES``, and candidates around it.

        Ends of long rays are where light leaves for other surfels, so a lit strip beside a gap has samples; those of
        short ones would crowd in narrow places. Light proxies get none: rounding errors would decide which of their
        sides the light is on; rays find the light of other proxies there. Nor has a surfel samples that face elsewhere:
        those on top of a roof, where there are few surfels, would light the walls below it.
        """
        ends, start = self._rays.static, np.repeat(np.arange(self.used), self.rays)
        is_long = ends.distance > MIN_SAMPLED_RADII * self.radius[start]
        is_long &= self._face_alike(ends, self._static_index)
        met = np.where(is_long & ~ends.is_light_proxy, self._static_index, -1)
        far = _select_of_each(met, np.full(self.used, MAX_END_SAMPLES))
        surfel = self._nearest(candidates)
        surfel[chosen] = np.arange(self.used)
        surfel[candidates.is_light_proxy | ~self._face_alike(candidates, surfel)] = -1
        near = _select_of_each(surfel, MAX_LIGHT_SAMPLES - np.bincount(met[far], minlength=self.used))
        owner = np.concatenate([met[far], surfel[near]])
        order = np.argsort(owner, kind="stable")
        self.light_sample_surfel = owner[order]
        hits = concatenate([ends.select(far), candidates.select(near)]).select(order)
        self._light_samples = AttachedPoints(self._caster, hits.position, hits.normal, hits.anchors)
        self.light_sample_position, self.light_sample_normal = self._light_samples.current()

    def _face_alike(self, hits: Hits, surfel: Ints) -> NDArray[np.bool_]:
        return np.asarray(row_dots(hits.normal, self.normal.take(surfel, axis=0)) > MIN_SAMPLE_COSINE)

    def _find_clip_planes(self, height: F32) -> F32:
        """Clip planes of the surfels on static surfaces; ``height`` is how far each surfel sees, shape (used,)."""
        static = np.flatnonzero(self._surfels.anchors.body == STATIC)
        planes = np.zeros((self.count, 4), np.float32)
        planes[static] = find_clip_planes(self._caster, self.position[static], self.normal[static],
                                          self.radius[static], height[static])
        return planes

    def _trace(self) -> None:
        changed = self._rays.trace_changes()
        index, albedo = self._static_index.copy(), self._rays.static.albedo.copy()
        index[changed.ray] = self._nearest(changed.hits)[changed.hit]
        put_rows(albedo, changed.ray, changed.hits.albedo.take(changed.hit, axis=0))
        albedo[index < 0] = 0.0
        self.index = self._pad(index.reshape(self.used, self.rays), -1)
        self.albedo = self._pad(albedo.reshape(self.used, self.rays, 3))
        self.emissive_irradiance = np.zeros((self.count, 3), np.float32)
        if self._emission_rays is not None:
            self.emissive_irradiance[:self.used] = _gather_emission(self._emission_rays, False)
        self.proxy_irradiance = np.zeros((self.count, 3), np.float32)
        self.proxy_irradiance[:self.used][self._is_light_proxy] = _gather_emission(self._proxy_rays, True)
        self.sky_irradiance = np.zeros((self.count, 3), np.float32)
        if self._sky_rays is not None:
            self.sky_irradiance[:self.used] = self._sky_rays.irradiance()

    def _nearest(self, hits: Hits) -> Ints:
        """The surfel with the largest weight at each hit, on the same body if that has any; -1 for the sky.

        Light proxies and other surfaces never share surfels: the ceiling just behind a lamp may be very bright, but is
        hidden by it.
        """
        nearest = np.full(len(hits.body), -1, np.int64)
        center = self.position[:max(self.used, 1)].mean(axis=0)  # for precision where the scene is much larger
        for body, proxy in product(range(len(self._caster.bodies)), (False, True)):
            surfels = np.flatnonzero((self._surfels.anchors.body == body) & (self._is_light_proxy == proxy))
            rows = np.flatnonzero((hits.body == body) & (hits.is_light_proxy == proxy))
            if len(surfels) == 0 and not proxy:  # the body is too small, or was absent when surfels were placed
                surfels = np.flatnonzero(~self._is_light_proxy)
            if len(surfels) and len(rows):
                key = kernel.keys(self.position[surfels] - center, self.normal[surfels], self.radius[surfels])
                plane = self.clip_plane[surfels].copy()
                plane[:, 3] += plane[:, :3] @ center
                clip = kernel.clip_keys(plane, self.radius[surfels])
                nearest[rows] = surfels[neighbours.nearest(key, clip, hits.position[rows] - center, hits.normal[rows])]
        return nearest

    def _pad(self, rows: NDArray[Any], fill: float = 0.0) -> F32:
        """``count`` rows of float32 that start with ``rows``."""
        padded = np.full((self.count, *rows.shape[1:]), fill, np.float32)
        padded[:len(rows)] = rows
        return padded


def _gather_emission(rays: RayBundle, of_proxies: bool) -> F32:
    """Irradiance / π from light proxies or from other surfaces, shape (N, 3): the mean over cosine-distributed rays."""
    changed, found = rays.trace_changes(), rays.static.emission_of(of_proxies)
    put_rows(found, changed.ray, changed.hits.emission_of(of_proxies).take(changed.hit, axis=0))
    return np.asarray(found.reshape(len(found) // EMISSION_RAYS, EMISSION_RAYS, 3).mean(axis=1))


def _select_of_each(owner: Ints, most: Ints) -> Ints:
    """Indices of rows, spread evenly over those of each owner, at most ``most`` of its own; none where it is -1."""
    order = np.argsort(owner, kind="stable")
    order = order[owner[order] >= 0]
    owner = owner[order]
    number = np.bincount(owner, minlength=len(most))
    rank = np.arange(len(order)) - (np.cumsum(number) - number)[owner]
    number, most = number[owner], most[owner]
    return np.asarray(order[rank * most // number > (rank - 1) * most // number])


def _estimate_spacing(positions: F32, count: int, extent: float) -> float:
    """Approximate distance between ``count`` surfels spread over ``positions``, in scene units."""
    subset = positions[:: max(1, len(positions) // max(count, 1))]
    nearest = neighbour_distance(subset, 1)
    return float(2 * np.median(nearest)) if len(subset) > 1 else extent
