"""Many emissive pieces as few lights: power, order, and irradiance against quadrature over the pieces."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from app.load.emission_patches import EmissiveTriangles
from app.load.emitters import find_emitters
from app.load.geometry import RawMesh
from app.load.light_fit import Receivers
from app.load.light_tree import MAX_LIGHTS
from app.load.light_views import MIN_SHARE, find_views
from app.load.scene_builder import SceneBuilder
from app.scene import Light, Material, PointLight, RectLight

F64 = NDArray[np.float64]
ROOM = np.array([6.0, 3.0, 5.0])  # centred at the origin
COLORS = ((8.0, 6.0, 3.0), (1.0, 6.0, 9.0))
FIBONACCI = 400  # points on a sphere
STEPS = 16       # points along an edge of a rectangle


@dataclass(frozen=True, eq=False)
class Emission:
    """Emitting points with unit normals; radiance times area in W/sr."""

    position: F64
    normal: F64
    strength: F64

    def irradiance(self, points: F64, normals: F64) -> F64:
        """Unoccluded, at ``points`` [N, 3]."""
        total = np.zeros((len(points), 3))
        for k in range(0, len(self.position), 4000):
            to = self.position[None, k:k + 4000] - points[:, None]
            cosines = [np.maximum((sign * to * n).sum(-1), 0)
                       for sign, n in ((1, normals[:, None]), (-1, self.normal[None, k:k + 4000]))]
            total += cosines[0] * cosines[1] / (to * to).sum(-1) ** 2 @ self.strength[k:k + 4000]
        return total


def emission_of_mesh(mesh: trimesh.Trimesh, colors: Iterable[int], max_edge: float = 0.05) -> Emission:
    """One-sided, of each face in one of ``COLORS``."""
    vertices, faces, source = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, max_edge, return_index=True)
    fine = trimesh.Trimesh(vertices, faces, process=False)
    return Emission(fine.triangles_center, mesh.face_normals[source],
                    fine.area_faces[:, None] * np.array(COLORS)[np.asarray(colors)[source]])


def emission_of_lights(lights: Iterable[Light]) -> Emission:
    z = 1 - (2 * np.arange(FIBONACCI) + 1) / FIBONACCI
    angle, sine = np.arange(FIBONACCI) * np.pi * (3 - np.sqrt(5)), np.sqrt(1 - z * z)
    ball = np.stack([sine * np.cos(angle), sine * np.sin(angle), z], axis=1)
    at = (np.arange(STEPS) + 0.5) / STEPS - 0.5
    s, t = (x.reshape(-1, 1) for x in np.meshgrid(at, at))
    parts = []
    for light in lights:
        if isinstance(light, PointLight):
            parts.append((light.position + light.radius * ball, ball,
                          np.tile(np.multiply(light.intensity, 4 / FIBONACCI), (FIBONACCI, 1))))
            continue
        assert isinstance(light, RectLight)
        facing = np.cross(light.edge_u, light.edge_v)
        area = np.linalg.norm(facing)
        strength = np.tile(np.multiply(light.radiance, area / STEPS**2), (STEPS**2, 1))
        parts += [(light.center + s * np.array(light.edge_u) + t * np.array(light.edge_v),
                   np.tile(side * facing / area, (STEPS**2, 1)), strength)
                  for side in ((1, -1) if light.two_sided else (1,))]
    return Emission(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def power_of(lights: Iterable[Light]) -> F64:
    """W per channel."""
    return np.pi * emission_of_lights(lights).strength.sum(axis=0)


def emissive(double_sided: bool = False) -> list[Material]:
    return [Material(), *(Material(emission=c, double_sided=double_sided) for c in COLORS)]


def lights_of(mesh: trimesh.Trimesh, colors: NDArray[np.int64], double_sided: bool = False) -> list[Light]:
    """The lights of a mesh in a room, with each face in one of ``COLORS``."""
    builder = SceneBuilder("test", materials=emissive(double_sided))
    walls = trimesh.creation.box(extents=ROOM)
    parts = [(walls.vertices, walls.faces[:, ::-1], 0)]
    parts += [(mesh.vertices, mesh.faces[colors == c], c + 1) for c in np.unique(colors)]
    for vertices, faces, material in parts:
        index = builder.add_mesh("part", RawMesh(np.asarray(vertices, np.float64), np.asarray(faces)), material)
        assert index is not None
        builder.add_instance("part", index, np.eye(4))
    find_emitters(builder)
    return builder.lights


def wall_points(count: int = 300) -> tuple[F64, F64]:
    walls = trimesh.creation.box(extents=ROOM)
    points, face = trimesh.sample.sample_surface(walls, count, seed=3)
    return np.asarray(points), -walls.face_normals[face]


def mean_error(mesh: trimesh.Trimesh, colors: NDArray[np.int64], lights: Iterable[Light]) -> float:
    """Of irradiance on the walls, relative."""
    expected = emission_of_mesh(mesh, colors).irradiance(*wall_points())
    seen = expected.sum(axis=1) > 0.01 * expected.sum(axis=1).mean()
    light = emission_of_lights(lights).irradiance(*wall_points())
    return float((np.abs(light - expected).sum(axis=1)[seen] / expected.sum(axis=1)[seen]).mean())


def copies(part: trimesh.Trimesh, centers: Iterable[Iterable[float]]) -> trimesh.Trimesh:
    parts = []
    for center in centers:
        parts.append(part.copy())
        parts[-1].apply_translation(list(center))
    return trimesh.util.concatenate(parts)


def downward_quad(size: float) -> trimesh.Trimesh:
    corners = size * np.array([(-0.5, 0, -0.5), (0.5, 0, -0.5), (0.5, 0, 0.5), (-0.5, 0, 0.5)])
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


def chandelier() -> trimesh.Trimesh:
    """200 bulbs on three rings."""
    centers = [(r * np.cos(a), y, r * np.sin(a)) for r, y, n in ((0.7, 0.6, 90), (0.5, 0.8, 70), (0.25, 0.95, 40))
               for a in 2 * np.pi * np.arange(n) / n]
    return copies(trimesh.creation.icosphere(1, 0.02), centers)


def shelf() -> trimesh.Trimesh:
    """Five rows of 80 LEDs, close to a wall."""
    return copies(downward_quad(0.01), [(x, y, -2.2) for y in np.linspace(-1.1, 0.9, 5)
                                        for x in np.linspace(-1.5, 1.5, 80)])


def downlights(rows: int, columns: int) -> trimesh.Trimesh:
    """A grid on the ceiling."""
    return copies(downward_quad(0.15), [(6 * (i + 0.5) / columns - 3, 1.49, 5 * (k + 0.5) / rows - 2.5)
                                        for i in range(columns) for k in range(rows)])


def neon() -> trimesh.Trimesh:
    """A thin tube along a curve."""
    t = np.linspace(0, 1.5 * np.pi, 200)
    path = np.stack([1.8 * np.cos(t), 0.5 + 0.4 * np.sin(2 * t), 1.8 * np.sin(t)], axis=1)
    along = np.gradient(path, axis=0)
    side = np.cross(along, (0, 1, 0))
    frame = [v / np.linalg.norm(v, axis=1, keepdims=True) for v in (side, np.cross(side, along))]
    angle = 2 * np.pi * np.arange(12)[:, None] / 12
    rings = path[:, None] + 0.015 * (np.cos(angle) * frame[0][:, None] + np.sin(angle) * frame[1][:, None])
    k, i = (x.ravel() for x in np.mgrid[:199, :12])
    a, b = 12 * k + i, 12 * k + (i + 1) % 12
    faces = np.concatenate([np.stack([a, b + 12, b], 1), np.stack([a, a + 12, b + 12], 1)])
    tube = trimesh.Trimesh(rings.reshape(-1, 3), faces, process=False)
    outward = tube.triangles_center - np.tile((path[:-1] + path[1:]).repeat(12, axis=0) / 2, (2, 1))
    assert ((tube.face_normals * outward).sum(axis=1) > 0).all()
    return tube


def shade() -> trimesh.Trimesh:
    """A cylinder without caps."""
    tube = trimesh.creation.cylinder(0.3, 0.4, sections=48)
    tube.update_faces(np.abs(tube.face_normals[:, 2]) < 0.5)
    tube.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    tube.apply_translation((1.5, 0.0, -1.0))
    return tube


def ball() -> trimesh.Trimesh:
    return copies(trimesh.creation.icosphere(4, 0.6), [(0.0, -0.5, -1.2)])


def corner_strip() -> trimesh.Trimesh:
    """Flat and L-shaped."""
    outline = np.array([(0, 0), (2, 0), (2, 0.3), (0.3, 0.3), (0.3, 2), (0, 2)])
    return trimesh.Trimesh(np.insert(outline, 1, 1.4, axis=1), [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]],
                           process=False)


@pytest.mark.parametrize(("make", "max_error"), [
    (chandelier, 0.02), (shelf, 0.02), (lambda: downlights(4, 8), 1e-3), (lambda: downlights(6, 6), 0.03),
    (neon, 0.05), (shade, 0.02), (ball, 0.01), (corner_strip, 0.01)],
    ids=["chandelier", "shelf", "32 downlights", "36 downlights", "neon", "shade", "ball", "corner strip"])
def test_irradiance_of_clusters(make: Callable[[], trimesh.Trimesh], max_error: float) -> None:
    """The error of the unoccluded irradiance on walls, and the power of each channel."""
    mesh = make()
    colors = np.zeros(len(mesh.faces), np.int64)
    lights = lights_of(mesh, colors)
    error = mean_error(mesh, colors, lights)
    print(f"{len(lights)} lights, mean error {error:.2%}")
    assert len(lights) <= MAX_LIGHTS
    assert error < max_error
    np.testing.assert_allclose(power_of(lights), np.pi * mesh.area * np.array(COLORS[0]), rtol=1e-6)


def test_pieces_of_different_colours_keep_the_power_of_each_channel() -> None:
    """Rows of alternating colours."""
    mesh = shelf()
    colors = np.arange(len(mesh.faces)) // 2 % 2
    lights = lights_of(mesh, colors)
    areas = [mesh.area_faces[colors == c].sum() for c in (0, 1)]
    np.testing.assert_allclose(power_of(lights), np.pi * np.array(areas) @ np.array(COLORS), rtol=1e-6)
    assert mean_error(mesh, colors, lights) < 0.02


@pytest.mark.parametrize("make", [chandelier, lambda: downlights(6, 6), shade], ids=["chandelier", "grid", "shade"])
def test_the_order_of_pieces_does_not_matter(make: Callable[[], trimesh.Trimesh]) -> None:
    """Nor that of triangles, even where symmetry makes many divisions equally good."""
    mesh = make()
    shuffled = mesh.copy()
    shuffled.faces = shuffled.faces[np.random.default_rng(0).permutation(len(mesh.faces))]
    first, second = (lights_of(m, np.zeros(len(m.faces), np.int64)) for m in (mesh, shuffled))
    assert first == second


def test_a_two_sided_open_shape_emits_to_both_sides() -> None:
    mesh = corner_strip()
    lights = lights_of(mesh, np.zeros(len(mesh.faces), np.int64), double_sided=True)
    np.testing.assert_allclose(power_of(lights), 2 * np.pi * mesh.area * np.array(COLORS[0]), rtol=1e-6)
    assert all(isinstance(light, RectLight) and light.two_sided for light in lights)


def tubes(rows: Iterable[tuple[float, float]], count: int) -> trimesh.Trimesh:
    """Rows along x at heights and depths (y, z), of tubes that fill half of each row."""
    tube = trimesh.creation.cylinder(0.016, 5.6 / count / 2, sections=12)
    tube.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    return copies(tube, [(5.6 * (i + 0.5) / count - 2.8, y, z) for y, z in rows for i in range(count)])


def test_rows_of_tubes_are_lines() -> None:
    """More tubes than lights: each light stands for tubes of one row, so that a glossy floor shows the rows."""
    rows = (1.2, -0.6), (1.2, 0.6)
    mesh = tubes(rows, 20)
    lights = lights_of(mesh, np.zeros(len(mesh.faces), np.int64))
    for light in lights:
        assert isinstance(light, RectLight)
        np.testing.assert_allclose(np.abs(light.center[1:]), rows[1], atol=1e-3)
        assert abs(light.edge_u[0]) > 10 * np.linalg.norm(light.edge_v)
    assert len(lights) < MAX_LIGHTS
    assert mean_error(mesh, np.zeros(len(mesh.faces), np.int64), lights) < 0.09  # crossed rectangles are no tubes


@pytest.mark.parametrize(("case_material", "shows_lamp"), [
    (Material(), False), (Material(is_back_culled=True), False),
    (Material(albedo=(0.0,) * 3, is_back_culled=True), True)], ids=["case", "one-sided case", "outline"])
def test_receivers_see_emitters_past_no_wall(case_material: Material, shows_lamp: bool) -> None:
    """A panel in a ceiling, a bulb around its opaque core, and a lamp in a case, from points of the room."""
    core, case = trimesh.creation.icosphere(1, 0.02), trimesh.creation.box(extents=(0.5, 0.5, 0.5))
    case.apply_translation((2.0, -1.0, 1.5))
    builder = SceneBuilder("test", materials=[Material(), case_material])
    for mesh, material in ((trimesh.creation.box(extents=ROOM), 0), (core, 0), (case, 1)):
        index = builder.add_mesh("part", RawMesh(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)),
                                 material)
        assert index is not None
        builder.add_instance("part", index, np.eye(4))
    panel = copies(downward_quad(0.3), [(0.0, ROOM[1] / 2, 0.5)])
    lamp = copies(trimesh.creation.icosphere(1, 0.05), [(2.0, -1.0, 1.5)])
    parts = panel, trimesh.creation.icosphere(1, 0.05), lamp
    patch = np.repeat(np.arange(3), [len(part.faces) for part in parts])
    triangles = EmissiveTriangles(np.concatenate([part.triangles for part in parts]), np.ones((len(patch), 3)),
                                  np.zeros(len(patch), bool), patch)
    points, normals = wall_points(50)
    below = points[:, 1] < ROOM[1] / 2 - 1e-6
    views = find_views(builder, set(), Receivers(points[below], normals[below]), triangles, patch, np.zeros(3))
    of_panel, of_bulb, of_lamp = views.visibility.T
    assert (of_panel == 1).all() and (of_lamp == (1 if shows_lamp else MIN_SHARE)).all()
    assert (of_bulb == 1).mean() > 0.9  # from elsewhere the few points that are looked at face away


def test_ten_thousand_pieces_take_about_a_second() -> None:
    rng = np.random.default_rng(1)
    mesh = copies(trimesh.creation.icosphere(0, 0.01), rng.uniform((-2.5, -1, -2), (2.5, 1.4, 2), (10000, 3)))
    start = time.process_time()
    lights = lights_of(mesh, np.zeros(len(mesh.faces), np.int64))
    assert time.process_time() - start < 4  # with room for a busy machine
    assert len(lights) <= MAX_LIGHTS
