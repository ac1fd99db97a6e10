"""Rays through a scene at one time: all static instances form one Embree scene, each moving instance its own.

Points can be attached to these bodies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.arrays import F32, F64, Bools, Ints
from app.math3d import affine_inverse, normal_matrix, translation
from app.raycast.body import Body
from app.raycast.prefiltered_textures import PrefilteredTextures
from app.scene import Scene

STATIC = 0            # index of the body of all instances that never move
MAX_CUT_OUTS = 16     # alpha-tested surfaces that a ray can pass through
PAST_HIT = 1.0001     # lengths of a ray by which it goes on behind what it passes
RAY_EPSILON = 1e-4    # offset of ray origins from their surface, relative to the scene's longest edge


@dataclass(frozen=True, eq=False)
class Hits:
    """Where rays end, in local space (world axes, the scene's centre as origin, scene units).

    Attributes
    ----------
    position, normal : ndarray, float32, shape (N, 3)
        The shading normal has unit length and lies on the side of the ray's origin.
    albedo, emission : ndarray, float32, shape (N, 3)
    distance : ndarray, float32, shape (N,)
        In lengths of the ray's direction; infinite for the sky.
    body : ndarray of int, shape (N,)
        Index into ``Caster.bodies``; -1 for the sky.
    is_light_proxy : ndarray of bool, shape (N,)
        Whether the surface is the mesh of an analytic light.
    """

    position: F32
    normal: F32
    albedo: F32
    emission: F32
    distance: F32
    body: Ints
    is_light_proxy: Bools

    def select(self, rows: Bools | Ints) -> Hits:
        """The hits at an index or mask."""
        return Hits(*(values[rows] for values in vars(self).values()))


def concatenate(parts: Sequence[Hits]) -> Hits:
    """The hits of all parts, in order."""
    return Hits(*(np.concatenate(values) for values in zip(*(vars(p).values() for p in parts), strict=True)))


class Caster:
    """Casts rays at ``scene`` as it is at the time of the last ``move_to``, 0 at first.

    Attributes
    ----------
    origin : ndarray, float64, shape (3,)
        Local space's origin in world space.
    bodies : list of Body
        The static body, then one for each moving instance.
    matrices : list of ndarray, float64, shape (4, 4)
        From each body's space to local space.
    dynamic_instances : tuple of int
        The scene's instance that each body but the first stands for.
    extent : float
        Longest edge of the scene, scene units.
    """

    def __init__(self, scene: Scene) -> None:
        self.origin = scene.bounds.mean(axis=0)
        self.extent = scene.longest_edge
        self.ray_epsilon = np.float32(RAY_EPSILON * scene.longest_edge)
        to_local, textures = translation(-self.origin), PrefilteredTextures()
        self._instances = scene.instances
        self.dynamic_instances = tuple(k for k, i in enumerate(scene.instances) if i.motion is not None)
        static = Body(scene, [(i, to_local @ i.transform) for i in scene.instances if i.motion is None], textures)
        self.bodies = [static, *(Body(scene, [(scene.instances[k], np.eye(4))], textures)
                                 for k in self.dynamic_instances)]
        self.move_to(0.0)

    def move_to(self, time: float) -> None:
        """Move the bodies to where they are at ``time`` seconds."""
        to_local = translation(-self.origin)
        self.matrices = [np.eye(4), *(to_local @ self._instances[k].transform_at(time) for k in self.dynamic_instances)]

    def cast(self, origins: F32, directions: F32, bodies: Sequence[int] | None = None,
             t_max: F32 | None = None) -> Hits:
        """Find the nearest surface along rays in local space.

        Parameters
        ----------
        origins, directions : ndarray, float32, shape (N, 3)
        bodies : sequence of int, optional
            The bodies that rays can meet; default all.
        t_max : ndarray, float32, shape (N,), optional
            Distance at which each ray ends, in lengths of its direction; default infinite.
        """
        count = len(origins)
        position, normal, albedo, emission = np.zeros((4, count, 3), np.float32)
        distance = np.full(count, np.inf, np.float32) if t_max is None else t_max.copy()
        hits = Hits(position, normal, albedo, emission, distance, np.full(count, -1, np.int64),
                    np.zeros(count, np.bool_))
        for index in range(len(self.bodies)) if bodies is None else bodies:
            self._cast_at(index, origins, directions, hits)
        met = hits.body >= 0
        hits.distance[~met] = np.inf
        hits.position[met] = origins[met] + directions[met] * hits.distance[met, None]
        return hits

    def is_occluded(self, origins: F32, vectors: F32, proxies_block: bool) -> Bools:
        """Whether a surface lies between each origin and the end of its vector, shape (N,).

        Parameters
        ----------
        origins, vectors : ndarray, float32, shape (N, 3)
            In local space.
        proxies_block : bool
            Whether the meshes of analytic lights count.
        """
        occluded = np.zeros(len(origins), np.bool_)
        for index, (body, matrix) in enumerate(zip(self.bodies, self.matrices, strict=True)):
            inverse = affine_inverse(matrix)
            if inverse is None:
                continue  # scaled to nothing
            rows = np.flatnonzero(~occluded)
            if index == STATIC:
                start, along = origins[rows], vectors[rows]
            else:
                rows = rows[_rays_towards(*self.bounding_sphere(index), origins[rows], vectors[rows],
                                          np.ones(len(rows), np.float32))]
                start = (origins[rows] @ inverse[:3, :3].T + inverse[:3, 3]).astype(np.float32)
                along = (vectors[rows] @ inverse[:3, :3].T).astype(np.float32)
            occluded[rows] = body.is_occluded(start, along, proxies_block)
            rows = np.flatnonzero(~occluded) if body.has_alpha_tested else rows[:0]
            start, along = origins[rows], vectors[rows]
            while len(rows):  # past light proxies, if these don't block
                hits = self.cast(start, along, (index,), np.ones(len(rows), np.float32))
                passes = hits.is_light_proxy & (not proxies_block)
                occluded[rows[(hits.body >= 0) & ~passes]] = True
                share = np.minimum(hits.distance[passes] * PAST_HIT, 1)[:, None]
                rows, start, along = rows[passes], start[passes] + share * along[passes], (1 - share) * along[passes]
        return occluded

    def random_points(self, count: int, rng: np.random.Generator) -> F32:
        """Points spread evenly over all surfaces but light proxies, shape (count, 3), in local space.

        None where there is nothing to spread them over.
        """
        corners = [(body.surface_corners() @ matrix[:3, :3].T + matrix[:3, 3])
                   for body, matrix in zip(self.bodies, self.matrices, strict=True)]
        a, b, c = np.moveaxis(np.concatenate(corners), 1, 0)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        if not area.sum() > 0:
            return np.zeros((0, 3), np.float32)
        chosen = rng.choice(len(area), count, p=area / area.sum())
        root, v = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
        points = (1 - root) * a[chosen] + root * (1 - v) * b[chosen] + root * v * c[chosen]
        return np.asarray(points, np.float32)

    def bounding_sphere(self, index: int) -> tuple[F32, float]:
        """Centre in local space, shape (3,), and radius of a sphere around body ``index``."""
        body, matrix = self.bodies[index], self.matrices[index]
        scale = float(np.linalg.norm(matrix[:3, :3], 2))
        return (matrix[:3, :3] @ body.center + matrix[:3, 3]).astype(np.float32), 1.001 * scale * body.radius

    def _cast_at(self, index: int, origins: F32, directions: F32, hits: Hits) -> None:
        """Update ``hits`` where body ``index`` is nearer than its distance."""
        body, matrix = self.bodies[index], self.matrices[index]
        inverse = affine_inverse(matrix)
        if inverse is None:
            return  # scaled to nothing
        rows = _rays_towards(*self.bounding_sphere(index), origins, directions, hits.distance)
        start, along = origins[rows], directions[rows]
        if index != STATIC:
            start = (start @ inverse[:3, :3].T + inverse[:3, 3]).astype(np.float32)
            along = (along @ inverse[:3, :3].T).astype(np.float32)
        passed = np.zeros(len(rows), np.float32)
        step = self.ray_epsilon / np.maximum(np.linalg.norm(directions[rows], axis=1), 1e-30)
        for _ in range(MAX_CUT_OUTS):
            distance, triangle, uv, face = body.cast(start + along * passed[:, None], along,
                                                     hits.distance[rows] - passed)
            cut_out = body.is_cut_out(triangle, uv)
            met = (triangle >= 0) & ~cut_out
            surface = body.interact(triangle[met], uv[met], face[met], along[met])
            to = rows[met]
            hits.normal[to] = transform_normals(surface.normal, matrix) if index != STATIC else surface.normal
            hits.albedo[to], hits.emission[to], hits.body[to] = surface.albedo, surface.emission, index
            hits.distance[to] = passed[met] + distance[met]
            hits.is_light_proxy[to] = body.is_light_proxy(triangle[met])
            if not cut_out.any():
                return
            passed = (passed + distance + step)[cut_out]
            rows, start, along, step = rows[cut_out], start[cut_out], along[cut_out], step[cut_out]


class AttachedPoints:
    """Points stored in the space of their body.

    Parameters
    ----------
    position, normal : ndarray, float32, shape (N, 3)
        In local space, for the bodies' current matrices in ``caster``.
    body : ndarray of int, shape (N,)
    """

    def __init__(self, caster: Caster, position: F32, normal: F32, body: Ints) -> None:
        self._caster, self.body = caster, body
        self._stored = self._transform(position, normal, [affine_inverse(m) for m in caster.matrices])

    def current(self) -> tuple[F32, F32]:
        """Positions and normals in local space, for the bodies' current matrices."""
        return self._transform(*self._stored, self._caster.matrices)

    def _transform(self, position: F32, normal: F32, matrices: Sequence[F64 | None]) -> tuple[F32, F32]:
        position, normal = position.copy(), normal.copy()
        for index, matrix in enumerate(matrices):
            rows = self.body == index
            if index != STATIC and matrix is not None and rows.any():
                position[rows] = position[rows] @ matrix[:3, :3].T + matrix[:3, 3]
                normal[rows] = transform_normals(normal[rows], matrix)
        return position, normal


def transform_normals(normals: F32, matrix: F64) -> F32:
    """Unit normals, shape (N, 3), in the space that ``matrix`` leads to."""
    normals = normals @ normal_matrix(matrix).T * np.sign(np.linalg.det(matrix[:3, :3]))
    return (normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)).astype(np.float32)


def _rays_towards(center: F32, radius: float, origins: F32, directions: F32, t_max: F32) -> Ints:
    """Indices of rays that may meet a sphere before ``t_max``."""
    to = center - origins
    along = (to * directions).sum(axis=1) / np.maximum((directions**2).sum(axis=1), 1e-30)
    off = ((to - directions * along[:, None])**2).sum(axis=1)
    inside = (to**2).sum(axis=1) <= radius**2
    near = along - radius / np.maximum(np.linalg.norm(directions, axis=1), 1e-30) <= t_max
    return np.flatnonzero(inside | ((off <= radius**2) & (along > 0) & near))
