"""Triangles that move together, and what their surfaces look like where a ray meets them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.errors import DeviceError
from app.math3d import normal_matrix
from app.network.channels import HALF_MAX
from app.raycast.prefiltered_textures import Prefiltered, texels
from app.scene import Instance, Material, Mesh, Scene, Texture

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Surface:
    """What rays met.

    Attributes
    ----------
    normal : ndarray, float32, shape (N, 3)
        Unit shading normal in the body's space, on the side of the ray's origin.
    albedo, emission : ndarray, float32, shape (N, 3)
        Emission in W/(sr m²), without emitters that are analytic lights.
    """

    normal: F32
    albedo: F32
    emission: F32


class Body:
    """Instances in one space, ready for rays.

    Parameters
    ----------
    placed : iterable of (Instance, ndarray)
        Instances, each with its matrix from object space to the body's.
    textures : Prefiltered
        Blurred copies, which the bodies of a scene share.
    """

    def __init__(self, scene: Scene, placed: Iterable[tuple[Instance, F64]], textures: Prefiltered) -> None:
        self._textures = textures
        parts = [_part(scene, instance, matrix) for instance, matrix in placed]
        self._materials = list({id(p.material): p.material for p in parts}.values())
        number = {id(m): k for k, m in enumerate(self._materials)}
        start = np.cumsum([0, *(len(p.positions) for p in parts)])
        self.triangles = _joined([p.triangles + s for p, s in zip(parts, start, strict=False)], (0, 3), np.int64)
        self.positions = _joined([p.positions for p in parts], (0, 3), np.float32)
        self._normals = _joined([p.normals for p in parts], (0, 3), np.float32)
        self._uvs = _joined([p.uvs for p in parts], (0, 2), np.float32)
        self._colors = _joined([p.colors for p in parts], (0, 4), np.float32)
        self._material = _joined([np.full(len(p.triangles), number[id(p.material)]) for p in parts], (0,), np.int64)
        self._mirrored = _joined([np.full(len(p.triangles), p.mirrored) for p in parts], (0,), np.bool_)
        self._scene = _embree_scene(self.positions, self.triangles) if len(self.triangles) else None
        corners = self.positions if len(self.positions) else np.zeros((1, 3), np.float32)
        low, high = corners.min(axis=0).astype(np.float64), corners.max(axis=0).astype(np.float64)
        self.centre, self.radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
        self._masked = np.array([m.alpha_cutoff is not None for m in self._materials], bool)
        self._lamps = np.array([m.is_light_proxy for m in self._materials], bool)

    def cast(self, origins: F32, directions: F32, most: F32) -> tuple[F32, Ints, F32, F32]:
        """The nearest triangle along each ray.

        Parameters
        ----------
        origins, directions : ndarray, float32, shape (N, 3)
        most : ndarray, float32, shape (N,)
            Farthest distance to look at, in lengths of the direction.

        Returns
        -------
        distance : ndarray, float32, shape (N,)
            In lengths of the direction; ``most`` where nothing is met.
        triangle : ndarray of int, shape (N,)
            -1 where nothing is met.
        uv : ndarray, float32, shape (N, 2)
            Barycentric coordinates of the second and third corner.
        face : ndarray, float32, shape (N, 3)
            Unit face normal on the side of the ray's origin.
        """
        count = len(origins)
        triangle, uv = np.full(count, -1, np.int64), np.zeros((count, 2), np.float32)
        face, distance = np.zeros((count, 3), np.float32), most.astype(np.float32)
        if self._scene is None or count == 0:
            return distance, triangle, uv, face
        found = self._scene.run(np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(directions, np.float32),
                                dists=distance.copy(), query="INTERSECT", output=True)
        hit = found["primID"] >= 0
        triangle[hit] = found["primID"][hit]
        uv[hit] = np.stack([found["u"], found["v"]], 1)[hit]
        distance[hit] = found["tfar"][hit]
        normal = found["Ng"][hit].astype(np.float64)  # of the triangle's area, whose square may be too large
        normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        away = (normal * directions[hit]).sum(axis=1) > 0
        face[hit] = np.where(away[:, None], -normal, normal)
        return distance, triangle, uv, face

    def transparent(self, triangle: Ints, uv: F32) -> NDArray[np.bool_]:
        """Where an alpha mask leaves nothing, shape (N,)."""
        through: NDArray[np.bool_] = np.zeros(len(triangle), np.bool_)
        met = np.flatnonzero(triangle >= 0)
        for index, rows in self._by_material(met[self._masked[self._material[triangle[met]]]], triangle):
            m = self._materials[index]
            alpha = np.full(len(rows), m.alpha, np.float32) * self._mix(self._colors, triangle[rows], uv[rows])[:, 3]
            if m.albedo_map is not None:
                alpha *= texels(m.albedo_map, self._mix(self._uvs, triangle[rows], uv[rows]))[:, 3]
            through[rows] = ~(alpha >= (m.alpha_cutoff or 0.0))
        return through

    def lamp(self, triangle: Ints) -> NDArray[np.bool_]:
        """Which triangles stand for analytic lights, shape (N,)."""
        return np.asarray(self._lamps[self._material[triangle]])

    def surface(self, triangle: Ints, uv: F32, face: F32, directions: F32) -> Surface:
        """What rays met, all of which met something; see ``cast``."""
        normal = self._mix(self._normals, triangle, uv)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = np.where(length > 1e-6, normal / np.maximum(length, 1e-30), face)
        normal = np.where((normal * face).sum(axis=1, keepdims=True) < 0, -normal, normal)
        albedo = self._mix(self._colors, triangle, uv)[:, :3]
        emission = np.zeros_like(albedo)
        front = self._front(triangle, directions)
        for index, rows in self._by_material(np.arange(len(triangle)), triangle):
            m = self._materials[index]
            at, masked = self._mix(self._uvs, triangle[rows], uv[rows]), m.alpha_cutoff is not None
            albedo[rows] *= self._shaded(m.albedo, m.albedo_map, at, masked)
            if m.emits and not m.is_light_proxy:
                lit = front[rows, None] | m.double_sided
                emission[rows] = np.where(lit, self._shaded(m.emission, m.emission_map, at, False), 0.0)
        return Surface(normal.astype(np.float32), np.clip(albedo, 0.0, 1.0), np.maximum(emission, 0.0))

    def _front(self, triangle: Ints, directions: F32) -> NDArray[np.bool_]:
        a, b, c = (self.positions[self.triangles[triangle, i]] for i in range(3))
        return ((np.cross(b - a, c - a) * directions).sum(axis=1) < 0) != self._mirrored[triangle]

    def _mix(self, values: F32, triangle: Ints, uv: F32) -> F32:
        """Vertex values between a triangle's corners."""
        a, b, c = (values[self.triangles[triangle, i]] for i in range(3))
        u, v = uv[:, :1], uv[:, 1:]
        mixed: F32 = (1 - u - v) * a + u * b + v * c
        return mixed

    def _shaded(self, factor: tuple[float, float, float], texture: Texture | None, uv: F32, masked: bool) -> F32:
        color = np.broadcast_to(np.asarray(factor, np.float32), (len(uv), 3))
        return color if texture is None else color * self._textures.color(texture, uv, masked)

    def _by_material(self, rows: Ints, triangle: Ints) -> Iterable[tuple[int, Ints]]:
        material = self._material[triangle[rows]]
        order = np.argsort(material, kind="stable")
        found, start = np.unique(material[order], return_index=True)
        return zip(found.tolist(), np.split(rows[order], start[1:]), strict=True) if len(rows) else ()


def embree() -> tuple[Any, Any]:
    """Embree's classes of scenes and meshes; not imported before surfels are wanted.

    Raises
    ------
    DeviceError
        Where the package is missing.
    """
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError:
        raise DeviceError("no ray tracer for a network that reads surfels", "embreex",
                          "expected the package embreex, or --model radiosity") from None
    return EmbreeScene, TriangleMesh


def _embree_scene(positions: F32, triangles: Ints) -> Any:
    scene_class, mesh_class = embree()
    scene = scene_class()
    mesh_class(scene, positions, triangles.astype(np.int32))
    return scene


@dataclass(frozen=True, eq=False)
class _Part:
    positions: F32
    normals: F32
    uvs: F32
    colors: F32
    triangles: Ints
    material: Material
    mirrored: bool


def _part(scene: Scene, instance: Instance, matrix: F64) -> _Part:
    """One instance's mesh in the body's space, without triangles that have broken corners."""
    mesh: Mesh = scene.meshes[instance.mesh]
    count = len(mesh.positions)
    sound = np.asarray(np.isfinite(mesh.positions).all(axis=1))
    triangles = mesh.triangles[sound[mesh.triangles].all(axis=1)].astype(np.int64)
    with np.errstate(invalid="ignore"):
        positions = np.where(sound[:, None], mesh.positions, 0.0) @ matrix[:3, :3].T + matrix[:3, 3]
        normals = np.nan_to_num(mesh.normals, nan=0.0, posinf=0.0, neginf=0.0) @ normal_matrix(matrix).T
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.maximum(length, 1e-30)
    uvs = np.zeros((count, 2), np.float32) if mesh.uvs is None else _bounded(mesh.uvs, -HALF_MAX)
    colors = np.ones((count, 4), np.float32) if mesh.colors is None else _bounded(mesh.colors, 0.0)
    material = scene.materials[mesh.material]
    if mesh.uvs is None and (material.albedo_map or material.emission_map):
        material = replace(material, albedo_map=None, emission_map=None)
    return _Part(positions.astype(np.float32), normals.astype(np.float32), uvs, colors, triangles, material,
                 bool(np.linalg.det(matrix[:3, :3]) < 0))


def _bounded(values: F32, low: float) -> F32:
    """Numbers between ``low`` and the largest half float, between which corners can be mixed."""
    return np.nan_to_num(values).clip(np.float32(low), np.float32(HALF_MAX))


def _joined(arrays: list[NDArray[Any]], shape: tuple[int, ...], dtype: type) -> NDArray[Any]:
    return np.concatenate([np.zeros(shape, dtype), *arrays]).astype(dtype, copy=False)
