"""Rays through a scene at a moment: all that stands still in one Embree scene, each moving instance in its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.math3d import affine_inverse, normal_matrix, translation
from app.raycast.body import Body
from app.raycast.prefiltered_textures import Prefiltered
from app.scene import Scene

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Ints = NDArray[np.int64]

STATIC = 0  # the body of all that never moves
MASKS = 16  # alpha-masked surfaces that a ray passes at most
RAY_EPSILON = 1e-4  # of the scene's longest edge: how far rays start off their surface


@dataclass(frozen=True, eq=False)
class Hits:
    """Where rays ended, in local space (world axes, the scene's centre as origin, scene units).

    Attributes
    ----------
    position, normal : ndarray, float32, shape (N, 3)
        The shading normal is of unit length, on the side of the ray's origin.
    albedo, emission : ndarray, float32, shape (N, 3)
    distance : ndarray, float32, shape (N,)
        In lengths of the ray's direction; infinite for the sky.
    body : ndarray of int, shape (N,)
        Index into ``Caster.bodies``; -1 for the sky.
    lamp : ndarray of bool, shape (N,)
        Whether it is the mesh of an analytic light.
    """

    position: F32
    normal: F32
    albedo: F32
    emission: F32
    distance: F32
    body: Ints
    lamp: NDArray[np.bool_]

    def arrays(self) -> tuple[NDArray[Any], ...]:
        """All attributes, in order."""
        return self.position, self.normal, self.albedo, self.emission, self.distance, self.body, self.lamp

    def rows(self, which: NDArray[np.bool_] | Ints) -> Hits:
        """Some of them."""
        return Hits(*(a[which] for a in self.arrays()))


def joined(parts: list[Hits]) -> Hits:
    """All of them, one after the other."""
    return Hits(*(np.concatenate(arrays) for arrays in zip(*(p.arrays() for p in parts), strict=True)))


class Caster:
    """Casts rays at ``scene`` as it stands at the newest ``place``.

    Attributes
    ----------
    origin : ndarray, float64, shape (3,)
        Local space's origin in world space.
    bodies : list of Body
        The still one first.
    matrices : list of ndarray, float64, shape (4, 4)
        From each body's space to local space.
    dynamic_instances : tuple of int
        The instance of every body but the first.
    """

    def __init__(self, scene: Scene) -> None:
        self.origin = scene.bounds.mean(axis=0)
        self.ray_epsilon = np.float32(RAY_EPSILON * scene.longest_edge)
        to_local, textures = translation(-self.origin), Prefiltered()
        self._instances = scene.instances
        self.dynamic_instances = tuple(k for k, i in enumerate(scene.instances) if i.motion is not None)
        still = Body(scene, [(i, to_local @ i.transform) for i in scene.instances if i.motion is None], textures)
        self.bodies = [still, *(Body(scene, [(scene.instances[k], np.eye(4))], textures) for k in self.dynamic_instances)]
        self.place(0.0)

    def place(self, time: float) -> None:
        """Move the bodies to where they are at ``time`` seconds."""
        to_local = translation(-self.origin)
        self.matrices = [np.eye(4), *(to_local @ self._instances[k].transform_at(time) for k in self.dynamic_instances)]

    def cast(self, origins: F32, directions: F32, bodies: tuple[int, ...] | None = None,
             most: F32 | None = None) -> Hits:
        """The nearest surface along rays in local space.

        Parameters
        ----------
        origins, directions : ndarray, float32, shape (N, 3)
        bodies : tuple of int, optional
            Those to look at; all without.
        most : ndarray, float32, shape (N,), optional
            Farthest distance to look at.
        """
        count = len(origins)
        position, normal, albedo, emission = np.zeros((4, count, 3), np.float32)
        distance = np.full(count, np.inf, np.float32) if most is None else most.copy()
        nothing, no_lamp = np.full(count, -1, np.int64), np.zeros(count, np.bool_)
        hits = Hits(position, normal, albedo, emission, distance, nothing, no_lamp)
        for index in range(len(self.bodies)) if bodies is None else bodies:
            self._cast_at(index, origins, directions, hits)
        seen = hits.body >= 0
        hits.distance[~seen] = np.inf
        hits.position[seen] = origins[seen] + directions[seen] * hits.distance[seen, None]
        return hits

    def ball(self, index: int) -> tuple[F32, float]:
        """Centre in local space, shape (3,), and radius of a ball around body ``index``."""
        body, matrix = self.bodies[index], self.matrices[index]
        scale = float(np.linalg.norm(matrix[:3, :3], 2))
        return (matrix[:3, :3] @ body.centre + matrix[:3, 3]).astype(np.float32), 1.001 * scale * body.radius

    def _cast_at(self, index: int, origins: F32, directions: F32, hits: Hits) -> None:
        """Note in ``hits`` where body ``index`` is nearer than what is noted there."""
        body, matrix = self.bodies[index], self.matrices[index]
        inverse = affine_inverse(matrix)
        if inverse is None:
            return  # scaled to nothing
        rows = _towards(*self.ball(index), origins, directions, hits.distance)
        start, along = origins[rows], directions[rows]
        if index != STATIC:
            start = (start @ inverse[:3, :3].T + inverse[:3, 3]).astype(np.float32)
            along = (along @ inverse[:3, :3].T).astype(np.float32)
        passed = np.zeros(len(rows), np.float32)
        step = self.ray_epsilon / np.maximum(np.linalg.norm(directions[rows], axis=1), 1e-30)
        for _ in range(MASKS):
            left = hits.distance[rows] - passed
            distance, triangle, uv, face = body.cast(start + along * passed[:, None], along, left)
            masked = body.transparent(triangle, uv)
            met = (triangle >= 0) & ~masked
            surface = body.surface(triangle[met], uv[met], face[met], along[met])
            to = rows[met]
            hits.normal[to] = turned(surface.normal, matrix) if index != STATIC else surface.normal
            hits.albedo[to], hits.emission[to], hits.body[to] = surface.albedo, surface.emission, index
            hits.distance[to], hits.lamp[to] = passed[met] + distance[met], body.lamp(triangle[met])
            if not masked.any():
                return
            passed = (passed + distance + step)[masked]
            rows, start, along, step = rows[masked], start[masked], along[masked], step[masked]


def _towards(centre: F32, radius: float, origins: F32, directions: F32, most: F32) -> Ints:
    """Rays that may meet a ball before ``most``."""
    to = centre - origins
    along = (to * directions).sum(axis=1) / np.maximum((directions**2).sum(axis=1), 1e-30)
    off = ((to - directions * along[:, None])**2).sum(axis=1)
    inside = (to**2).sum(axis=1) <= radius**2
    near = along - radius / np.maximum(np.linalg.norm(directions, axis=1), 1e-30) <= most
    return np.flatnonzero(inside | ((off <= radius**2) & (along > 0) & near))


def turned(normals: F32, matrix: F64) -> F32:
    """Normals, shape (N, 3), in the space that ``matrix`` leads to; unit length."""
    turned = normals @ normal_matrix(matrix).T * np.sign(np.linalg.det(matrix[:3, :3]))
    return (turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-30)).astype(np.float32)
