"""A set of triangles that moves as one, and the surface properties at the points where rays meet it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from app.arrays import F32, F64, Bools, Ints
from app.math3d import normal_matrix
from app.network.channels import HALF_MAX
from app.raycast.prefiltered_textures import PrefilteredTextures, sample_nearest
from app.scene import Instance, Material, Mesh, Scene, Texture


@dataclass(frozen=True, eq=False)
class SurfaceInteraction:
    """Surface properties at the hits of N rays.

    Attributes
    ----------
    normal : ndarray, float32, shape (N, 3)
        Unit shading normal in the body's space, on the side of the ray's origin.
    albedo, emission : ndarray, float32, shape (N, 3)
        Emission in W/(sr m²); 0 on light proxies, whose emission is an analytic light.
    """

    normal: F32
    albedo: F32
    emission: F32


class Body:
    """Instances that share one space, with an Embree scene for casting rays at them.

    Parameters
    ----------
    placed : iterable of (Instance, ndarray)
        Each instance with its matrix from object space to the body's space.
    textures : PrefilteredTextures
        Shared by all bodies of a scene.

    Attributes
    ----------
    has_alpha_tested : bool
        Whether rays can pass through some triangles; ``is_occluded`` leaves those out.
    """

    def __init__(self, scene: Scene, placed: Iterable[tuple[Instance, F64]], textures: PrefilteredTextures) -> None:
        self._textures = textures
        parts = [_transform_instance(scene, instance, matrix) for instance, matrix in placed]
        self._materials = list({id(p.material): p.material for p in parts}.values())
        number = {id(m): k for k, m in enumerate(self._materials)}
        start = np.cumsum([0, *(len(p.positions) for p in parts)])
        self.triangles = _concatenate([p.triangles + s for p, s in zip(parts, start, strict=False)], (0, 3), np.int64)
        self.positions = _concatenate([p.positions for p in parts], (0, 3), np.float32)
        self._normals = _concatenate([p.normals for p in parts], (0, 3), np.float32)
        self._uvs = _concatenate([p.uvs for p in parts], (0, 2), np.float32)
        self._colors = _concatenate([p.colors for p in parts], (0, 4), np.float32)
        self._material = _concatenate([np.full(len(p.triangles), number[id(p.material)]) for p in parts], (0,),
                                      np.int64)
        self._mirrored = _concatenate([np.full(len(p.triangles), p.mirrored) for p in parts], (0,), np.bool_)
        self._scene = _embree_scene(self.positions, self.triangles)
        corners = self.positions if len(self.positions) else np.zeros((1, 3), np.float32)
        low, high = corners.min(axis=0).astype(np.float64), corners.max(axis=0).astype(np.float64)
        self.center, self.radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
        self._alpha_tested = np.array([m.alpha_cutoff is not None for m in self._materials], bool)
        self._light_proxies = np.array([m.is_light_proxy for m in self._materials], bool)
        opaque, proxy = ~self._alpha_tested[self._material], self._light_proxies[self._material]
        blocks = opaque & ~proxy
        self._opaque = self._scene if blocks.all() else _embree_scene(self.positions, self.triangles[blocks])
        self._opaque_proxies = _embree_scene(self.positions, self.triangles[opaque & proxy])
        self.has_alpha_tested = bool((~opaque).any())

    def cast(self, origins: F32, directions: F32, t_max: F32) -> tuple[F32, Ints, F32, F32]:
        """Find the nearest triangle along each ray.

        Parameters
        ----------
        origins, directions : ndarray, float32, shape (N, 3)
        t_max : ndarray, float32, shape (N,)
            Distance at which each ray ends, in lengths of its direction.

        Returns
        -------
        distance : ndarray, float32, shape (N,)
            In lengths of the direction; ``t_max`` for a miss.
        triangle : ndarray of int, shape (N,)
            -1 for a miss.
        uv : ndarray, float32, shape (N, 2)
            Barycentric coordinates of the second and third corner.
        face : ndarray, float32, shape (N, 3)
            Unit face normal on the side of the ray's origin.
        """
        count = len(origins)
        triangle, uv = np.full(count, -1, np.int64), np.zeros((count, 2), np.float32)
        face, distance = np.zeros((count, 3), np.float32), t_max.astype(np.float32)
        if self._scene is None or count == 0:
            return distance, triangle, uv, face
        hits = self._scene.run(np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(directions, np.float32),
                               dists=distance.copy(), query="INTERSECT", output=True)
        hit = hits["primID"] >= 0
        triangle[hit] = hits["primID"][hit]
        uv[hit] = np.stack([hits["u"], hits["v"]], 1)[hit]
        distance[hit] = hits["tfar"][hit]
        normal = hits["Ng"][hit].astype(np.float64)  # as long as the area, whose square may overflow float32
        normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        away = (normal * directions[hit]).sum(axis=1) > 0
        face[hit] = np.where(away[:, None], -normal, normal)
        return distance, triangle, uv, face

    def is_occluded(self, origins: F32, vectors: F32, proxies_block: bool) -> Bools:
        """Whether an opaque triangle lies between each origin and the end of its vector, shape (N,).

        Parameters
        ----------
        origins, vectors : ndarray, float32, shape (N, 3)
            In the body's space.
        proxies_block : bool
            Whether light proxies count.
        """
        occluded = _meets(self._opaque, origins, vectors)
        if proxies_block and self._opaque_proxies is not None:
            left = np.flatnonzero(~occluded)
            occluded[left] = _meets(self._opaque_proxies, origins[left], vectors[left])
        return occluded

    def surface_corners(self) -> F32:
        """Corners of all triangles but those of light proxies, shape (T, 3, 3), in the body's space."""
        return self.positions[self.triangles[~self.is_light_proxy(np.arange(len(self.triangles)))]]

    def is_cut_out(self, triangle: Ints, uv: F32) -> Bools:
        """Whether the alpha test removes the surface at each hit, shape (N,)."""
        cut_out: Bools = np.zeros(len(triangle), np.bool_)
        met = np.flatnonzero(triangle >= 0)
        for index, rows in self._by_material(met[self._alpha_tested[self._material[triangle[met]]]], triangle):
            m = self._materials[index]
            alpha = np.full(len(rows), m.alpha, np.float32)
            alpha = alpha * self._interpolate(self._colors, triangle[rows], uv[rows])[:, 3]
            if m.albedo_map is not None:
                alpha *= sample_nearest(m.albedo_map, self._interpolate(self._uvs, triangle[rows], uv[rows]))[:, 3]
            cut_out[rows] = ~(alpha >= (m.alpha_cutoff or 0.0))
        return cut_out

    def is_light_proxy(self, triangle: Ints) -> Bools:
        """Whether each triangle stands for an analytic light, shape (N,)."""
        return np.asarray(self._light_proxies[self._material[triangle]])

    def interact(self, triangle: Ints, uv: F32, face: F32, directions: F32) -> SurfaceInteraction:
        """Evaluate the surface at hits of ``cast``, none of them a miss."""
        normal = self._interpolate(self._normals, triangle, uv)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = np.where(length > 1e-6, normal / np.maximum(length, 1e-30), face)
        normal = np.where((normal * face).sum(axis=1, keepdims=True) < 0, -normal, normal)
        albedo = self._interpolate(self._colors, triangle, uv)[:, :3]
        emission = np.zeros_like(albedo)
        front = self._is_front(triangle, directions)
        for index, rows in self._by_material(np.arange(len(triangle)), triangle):
            m = self._materials[index]
            at, alpha_tested = self._interpolate(self._uvs, triangle[rows], uv[rows]), m.alpha_cutoff is not None
            albedo[rows] *= self._textured(m.albedo, m.albedo_map, at, alpha_tested)
            if m.emits and not m.is_light_proxy:
                emits = front[rows, None] | m.double_sided
                emission[rows] = np.where(emits, self._textured(m.emission, m.emission_map, at, False), 0.0)
        return SurfaceInteraction(normal.astype(np.float32), np.clip(albedo, 0.0, 1.0), np.maximum(emission, 0.0))

    def _is_front(self, triangle: Ints, directions: F32) -> Bools:
        a, b, c = (self.positions[self.triangles[triangle, i]] for i in range(3))
        return ((np.cross(b - a, c - a) * directions).sum(axis=1) < 0) != self._mirrored[triangle]

    def _interpolate(self, values: F32, triangle: Ints, uv: F32) -> F32:
        """Vertex values at barycentric coordinates."""
        a, b, c = (values[self.triangles[triangle, i]] for i in range(3))
        u, v = uv[:, :1], uv[:, 1:]
        interpolated: F32 = (1 - u - v) * a + u * b + v * c
        return interpolated

    def _textured(self, factor: tuple[float, float, float], texture: Texture | None, uv: F32,
                  alpha_tested: bool) -> F32:
        color = np.broadcast_to(np.asarray(factor, np.float32), (len(uv), 3))
        return color if texture is None else color * self._textures.sample(texture, uv, alpha_tested)

    def _by_material(self, rows: Ints, triangle: Ints) -> Iterable[tuple[int, Ints]]:
        """Pairs of a material's index and those of ``rows`` whose triangle has it."""
        material = self._material[triangle[rows]]
        order = np.argsort(material, kind="stable")
        indices, start = np.unique(material[order], return_index=True)
        return zip(indices.tolist(), np.split(rows[order], start[1:]), strict=True) if len(rows) else ()


def _embree_scene(positions: F32, triangles: Ints) -> Any:
    """None without triangles."""
    if len(triangles) == 0:
        return None
    scene = EmbreeScene()
    TriangleMesh(scene, positions, triangles.astype(np.int32))
    return scene


def _meets(scene: Any, origins: F32, vectors: F32) -> Bools:
    """Whether anything of an Embree scene lies on each vector, shape (N,)."""
    if scene is None or len(origins) == 0:
        return np.zeros(len(origins), np.bool_)
    hits = scene.run(np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(vectors, np.float32),
                     dists=np.ones(len(origins), np.float32), query="OCCLUDED")
    return np.asarray(hits >= 0)


@dataclass(frozen=True, eq=False)
class _Part:
    positions: F32
    normals: F32
    uvs: F32
    colors: F32
    triangles: Ints
    material: Material
    mirrored: bool


def _transform_instance(scene: Scene, instance: Instance, matrix: F64) -> _Part:
    """One instance's mesh in the body's space, without triangles that have a non-finite corner."""
    mesh: Mesh = scene.meshes[instance.mesh]
    count = len(mesh.positions)
    finite = np.asarray(np.isfinite(mesh.positions).all(axis=1))
    triangles = mesh.triangles[finite[mesh.triangles].all(axis=1)].astype(np.int64)
    with np.errstate(invalid="ignore"):
        positions = np.where(finite[:, None], mesh.positions, 0.0) @ matrix[:3, :3].T + matrix[:3, 3]
        normals = np.nan_to_num(mesh.normals, nan=0.0, posinf=0.0, neginf=0.0) @ normal_matrix(matrix).T
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.maximum(length, 1e-30)
    uvs = np.zeros((count, 2), np.float32) if mesh.uvs is None else _clamp(mesh.uvs, -HALF_MAX)
    colors = np.ones((count, 4), np.float32) if mesh.colors is None else _clamp(mesh.colors, 0.0)
    material = scene.materials[mesh.material]
    if mesh.uvs is None and (material.albedo_map or material.emission_map):
        material = replace(material, albedo_map=None, emission_map=None)
    return _Part(positions.astype(np.float32), normals.astype(np.float32), uvs, colors, triangles, material,
                 bool(np.linalg.det(matrix[:3, :3]) < 0))


def _clamp(values: F32, low: float) -> F32:
    """Finite values between ``low`` and the largest half float, so that interpolation can't overflow."""
    return np.nan_to_num(values).clip(np.float32(low), np.float32(HALF_MAX))


def _concatenate(arrays: Sequence[NDArray[Any]], empty: tuple[int, ...], dtype: type) -> NDArray[Any]:
    """The arrays one after the other; of shape ``empty`` when there are none."""
    return np.concatenate([np.zeros(empty, dtype), *arrays]).astype(dtype, copy=False)
