"""Emissive surfaces -> analytic lights.

Each emissive mesh is split into connected pieces. A flat, rectangular piece is exactly a rectangle light. Another flat
piece becomes the rectangle that fits best, with the same power; any other piece becomes a sphere of the same area. Only
the most powerful pieces become lights; the others stay emissive surfaces.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from app.arrays import F64, Bools, Ints
from app.load.geometry import face_vectors
from app.load.images import mean_color
from app.load.scene_builder import SceneBuilder, color, vector
from app.scene import Instance, Light, Material, Mesh, PointLight, RectLight

MAX_LIGHTS = 16
_MAX_FLATNESS_ERROR = 1e-3
_MAX_AREA_ERROR = 0.01
_MAX_DIRECTIONS = 256
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709


@dataclass(frozen=True, eq=False)
class _Piece:
    """A connected piece of an emissive instance: indices of its triangles, and its power."""

    instance: int
    triangles: Ints
    power: float


def find_emitters(builder: SceneBuilder) -> None:
    """Add lights for the builder's emissive surfaces and mark the surfaces as light proxies."""
    pieces: list[_Piece] = []
    count = 0
    radiance: dict[int, F64] = {}
    for index, instance in enumerate(builder.instances):
        material = builder.materials[builder.meshes[instance.mesh].material]
        if not material.emits:
            continue
        if instance.motion is not None:
            builder.notice(f"{instance.name!r} moves, so it is emissive geometry and not an analytic light")
            continue
        radiance[index] = _mean_radiance(material)
        strongest, total = _split_into_pieces(index, instance, builder.meshes[instance.mesh],
                                              float(radiance[index] @ _LUMINANCE))
        pieces += strongest
        count += total
    chosen = sorted((p for p in pieces if p.power > 0), key=lambda p: -p.power)[:MAX_LIGHTS]
    if len(chosen) < count:
        builder.notice(f"the scene has {count} emissive pieces: the {len(chosen)} most powerful are analytic lights, "
                       "the others are emissive geometry")
    proxies: dict[int, list[Ints]] = {}
    for piece in sorted(chosen, key=lambda p: (p.instance, p.triangles[0])):
        instance = builder.instances[piece.instance]
        mesh = builder.meshes[instance.mesh]
        corners = _world_positions(mesh, instance)[mesh.triangles[piece.triangles]]
        material = builder.materials[mesh.material]
        mirrored = np.linalg.det(instance.transform[:3, :3]) < 0
        light, exact = _fit_light(corners[:, ::-1] if mirrored else corners, radiance[piece.instance],
                                  material.double_sided)
        builder.lights.append(light)
        if not exact:
            shape = "rectangle" if isinstance(light, RectLight) else "sphere"
            builder.notice(f"{instance.name!r} is emissive but no rectangle, so a {shape} light approximates it")
        proxies.setdefault(piece.instance, []).append(piece.triangles)
    _ProxySplitter(builder).split({i: np.concatenate(t) for i, t in proxies.items()})


def _mean_radiance(material: Material) -> F64:
    emission = np.asarray(material.emission)
    return emission if material.emission_map is None else emission * mean_color(material.emission_map.pixels)


def _world_positions(mesh: Mesh, instance: Instance) -> F64:
    return mesh.positions.astype(np.float64) @ instance.transform[:3, :3].T + instance.transform[:3, 3]


def _split_into_pieces(index: int, instance: Instance, mesh: Mesh, luminance: float) -> tuple[list[_Piece], int]:
    """The most powerful connected pieces of an instance, and the number of all."""
    label = _label_components(mesh)
    areas = np.linalg.norm(face_vectors(_world_positions(mesh, instance), mesh.triangles), axis=1) / 2
    power = np.bincount(label, areas) * math.pi * luminance
    strongest = np.argsort(-power, kind="stable")[:MAX_LIGHTS]
    return [_Piece(index, np.flatnonzero(label == k), float(power[k])) for k in strongest], len(power)


def _label_components(mesh: Mesh) -> Ints:
    """Number of the connected component of each triangle, shape (T,); corners at the same position are shared."""
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


def _fit_light(corners: F64, radiance: F64, two_sided: bool) -> tuple[Light, bool]:
    """The light for a piece with world-space triangle corners, shape (T, 3, 3), and whether it is exact."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    areas = np.linalg.norm(normals, axis=1)
    area = float(areas.sum())
    centroid = (corners.mean(axis=1) * areas[:, None]).sum(axis=0) / area
    total = normals.sum(axis=0)
    axis = total / max(float(np.linalg.norm(total)), 1e-300)
    points = corners.reshape(-1, 3) - centroid
    size = float(np.linalg.norm(points, axis=1).max())
    same_side = float(np.linalg.norm(total)) > (1 - _MAX_FLATNESS_ERROR) * area
    if not same_side or float(np.abs(points @ axis).max()) > _MAX_FLATNESS_ERROR * size:
        radius = math.sqrt(area / (4 * math.pi))
        return PointLight(vector(centroid), color(radiance * area / 4), radius), False
    u, v, center = _smallest_rectangle(points, axis)
    coverage = min(area / float(np.linalg.norm(u) * np.linalg.norm(v)), 1.0)
    exact = coverage > 1 - _MAX_AREA_ERROR
    return RectLight(vector(centroid + center), vector(u), vector(v), color(radiance * (1.0 if exact else coverage)),
                     two_sided), exact


def _smallest_rectangle(points: F64, normal: F64) -> tuple[F64, F64, F64]:
    """Edges u and v, with u × v along ``normal``, and centre of the smallest rectangle around planar points.

    One of its sides lies along an edge of the convex hull, so only the directions of triangle edges are tried.
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


class _ProxySplitter:
    """Gives triangles that became lights a copy of their material that is marked as a light proxy."""

    def __init__(self, builder: SceneBuilder) -> None:
        self._builder = builder
        self._materials: dict[int, int] = {}
        self._meshes: dict[tuple[int, bytes, bool], int] = {}

    def split(self, proxies: dict[int, Ints]) -> None:
        """Replace each instance in ``proxies`` by one of these triangles and, if any are left, one of the others."""
        for index, triangles in proxies.items():
            instance = self._builder.instances[index]
            mask = np.zeros(len(self._builder.meshes[instance.mesh].triangles), bool)
            mask[triangles] = True
            self._builder.instances[index] = replace(instance, mesh=self._extract(instance.mesh, mask, True))
            if not mask.all():
                self._builder.instances.append(replace(instance, mesh=self._extract(instance.mesh, ~mask, False)))

    def _extract(self, mesh: int, mask: Bools, proxy: bool) -> int:
        key = (mesh, mask.tobytes(), proxy)
        if key not in self._meshes:
            source = self._builder.meshes[mesh]
            material = self._proxy_material(source.material) if proxy else source.material
            self._meshes[key] = len(self._builder.meshes)
            self._builder.meshes.append(replace(source, triangles=source.triangles[mask], material=material))
        return self._meshes[key]

    def _proxy_material(self, material: int) -> int:
        if material not in self._materials:
            self._materials[material] = len(self._builder.materials)
            self._builder.materials.append(replace(self._builder.materials[material], is_light_proxy=True))
        return self._materials[material]
