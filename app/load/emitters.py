"""Emissive surfaces -> analytic lights.

A flat, rectangular piece of emissive mesh is a rectangle light exactly. Other flat pieces become the
rectangle that fits best, with the same power; anything else a sphere of the same area. Only the most
powerful pieces become lights; the rest stay emissive surfaces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.load.geometry import face_vectors
from app.load.images import mean_color
from app.load.scene_builder import SceneBuilder, color, vector
from app.scene import F64, Instance, Light, Material, Mesh, PointLight, RectLight

MAX_LIGHTS = 16
_FLAT_WITHIN = 1e-3
_SAME_AREA_WITHIN = 0.01
_MAX_DIRECTIONS = 256
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True, eq=False)
class _Piece:
    """A connected piece of an emissive instance: its triangles' indices, and its power."""

    instance: int
    triangles: NDArray[np.int64]
    power: float


def find_emitters(builder: SceneBuilder) -> None:
    """Add lights for the builder's emissive surfaces and mark their materials as analytic."""
    pieces: list[_Piece] = []
    count = 0
    radiance: dict[int, F64] = {}
    for index, instance in enumerate(builder.instances):
        material = builder.materials[builder.meshes[instance.mesh].material]
        if not material.emits:
            continue
        if instance.motion is not None:
            builder.notice(f"{instance.name!r} moves: it glows, but is no analytic light")
            continue
        radiance[index] = _radiance(material)
        found, total = _pieces(index, instance, builder.meshes[instance.mesh], float(radiance[index] @ _LUMINANCE))
        pieces += found
        count += total
    chosen = sorted((p for p in pieces if p.power > 0), key=lambda p: -p.power)[:MAX_LIGHTS]
    if len(chosen) < count:
        builder.notice(f"of {count} emissive pieces the {len(chosen)} most powerful are lights; "
                     "the others only glow and bounce")
    lit: dict[int, list[NDArray[np.int64]]] = {}
    for piece in sorted(chosen, key=lambda p: (p.instance, p.triangles[0])):
        instance = builder.instances[piece.instance]
        mesh = builder.meshes[instance.mesh]
        points = _world(mesh, instance)[mesh.triangles[piece.triangles]]
        material = builder.materials[mesh.material]
        mirrored = np.linalg.det(instance.transform[:3, :3]) < 0
        light, exact = _fit(points[:, ::-1] if mirrored else points, radiance[piece.instance], material.double_sided)
        builder.lights.append(light)
        if not exact:
            shape = "rectangle" if isinstance(light, RectLight) else "sphere"
            builder.notice(f"{instance.name!r} glows but is no rectangle: a {shape} light stands in for it")
        lit.setdefault(piece.instance, []).append(piece.triangles)
    _Splitter(builder).split({i: np.concatenate(t) for i, t in lit.items()})


def _radiance(material: Material) -> F64:
    emission = np.asarray(material.emission)
    return emission if material.emission_map is None else emission * mean_color(material.emission_map.pixels)


def _world(mesh: Mesh, instance: Instance) -> F64:
    return mesh.positions.astype(np.float64) @ instance.transform[:3, :3].T + instance.transform[:3, 3]


def _pieces(index: int, instance: Instance, mesh: Mesh, luminance: float) -> tuple[list[_Piece], int]:
    """The most powerful connected pieces of an instance, and the number of all."""
    label = _connected(mesh)
    areas = np.linalg.norm(face_vectors(_world(mesh, instance), mesh.triangles), axis=1) / 2
    power = np.bincount(label, areas) * math.pi * luminance
    strongest = np.argsort(-power, kind="stable")[:MAX_LIGHTS]
    return [_Piece(index, np.flatnonzero(label == k), float(power[k])) for k in strongest], len(power)


def _connected(mesh: Mesh) -> NDArray[np.int64]:
    """Number of the connected piece of each triangle, shape (T,); corners at one place are one."""
    _, weld = np.unique(mesh.positions, axis=0, return_inverse=True)
    corners = weld.reshape(-1)[mesh.triangles]
    label = np.arange(int(corners.max()) + 1)
    while True:
        lowest = label[corners].min(axis=1)
        merged = label.copy()
        np.minimum.at(merged, corners.ravel(), np.repeat(lowest, 3))
        merged = merged[merged]
        if np.array_equal(merged, label):
            return np.unique(lowest, return_inverse=True)[1].astype(np.int64)
        label = merged


def _fit(corners: F64, radiance: F64, two_sided: bool) -> tuple[Light, bool]:
    """The light for a piece with world-space triangle corners, shape (T, 3, 3), and whether it is exact."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    areas = np.linalg.norm(normals, axis=1)
    area = float(areas.sum())
    centroid = (corners.mean(axis=1) * areas[:, None]).sum(axis=0) / area
    total = normals.sum(axis=0)
    axis = total / max(float(np.linalg.norm(total)), 1e-300)
    points = corners.reshape(-1, 3) - centroid
    size = float(np.linalg.norm(points, axis=1).max())
    one_way = float(np.linalg.norm(total)) > (1 - _FLAT_WITHIN) * area
    if not one_way or float(np.abs(points @ axis).max()) > _FLAT_WITHIN * size:
        radius = math.sqrt(area / (4 * math.pi))
        return PointLight(vector(centroid), color(radiance * area / 4), radius), False
    u, v, center = _smallest_rectangle(points, axis)
    covered = min(area / float(np.linalg.norm(u) * np.linalg.norm(v)), 1.0)
    exact = covered > 1 - _SAME_AREA_WITHIN
    return RectLight(vector(centroid + center), vector(u), vector(v), color(radiance * (1.0 if exact else covered)),
                     two_sided), exact


def _smallest_rectangle(points: F64, normal: F64) -> tuple[F64, F64, F64]:
    """Edges u and v, with u × v along ``normal``, and centre of the smallest rectangle around planar points.

    One side of it lies along an edge of the outline, so only the directions of triangle edges are tried.
    """
    edges = (points.reshape(-1, 3, 3) - np.roll(points.reshape(-1, 3, 3), 1, axis=1)).reshape(-1, 3)
    edges -= np.outer(edges @ normal, normal)
    length = np.linalg.norm(edges, axis=1)
    longest = np.argsort(-length, kind="stable")[:_MAX_DIRECTIONS]
    us = edges[longest] / length[longest, None]
    vs = np.cross(normal, us)
    along_u, along_v = points @ us.T, points @ vs.T
    low = np.stack([along_u.min(axis=0), along_v.min(axis=0)])
    high = np.stack([along_u.max(axis=0), along_v.max(axis=0)])
    best = int(np.argmin(np.prod(high - low, axis=0)))
    (width, height), (mid_u, mid_v) = (high - low)[:, best], (high + low)[:, best] / 2
    return us[best] * width, vs[best] * height, us[best] * mid_u + vs[best] * mid_v


class _Splitter:
    """Gives the triangles that became lights an analytic copy of their material."""

    def __init__(self, builder: SceneBuilder) -> None:
        self._builder = builder
        self._materials: dict[int, int] = {}
        self._meshes: dict[tuple[int, bytes, bool], int] = {}

    def split(self, lit: dict[int, NDArray[np.int64]]) -> None:
        """Replace the mesh of each instance in ``lit`` by an analytic part and, where needed, a rest."""
        for index, triangles in lit.items():
            instance = self._builder.instances[index]
            mask = np.zeros(len(self._builder.meshes[instance.mesh].triangles), bool)
            mask[triangles] = True
            self._builder.instances[index] = replace(instance, mesh=self._part(instance.mesh, mask, True))
            if not mask.all():
                self._builder.instances.append(replace(instance, mesh=self._part(instance.mesh, ~mask, False)))

    def _part(self, mesh: int, mask: NDArray[np.bool_], analytic: bool) -> int:
        key = (mesh, mask.tobytes(), analytic)
        if key not in self._meshes:
            source = self._builder.meshes[mesh]
            material = self._analytic(source.material) if analytic else source.material
            self._meshes[key] = len(self._builder.meshes)
            self._builder.meshes.append(replace(source, triangles=source.triangles[mask], material=material))
        return self._meshes[key]

    def _analytic(self, material: int) -> int:
        if material not in self._materials:
            self._materials[material] = len(self._builder.materials)
            self._builder.materials.append(replace(self._builder.materials[material], is_light_proxy=True))
        return self._materials[material]
