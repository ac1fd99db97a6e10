"""Scenes of one triangle, of none, of a million; walls in one plane, mirrored objects, broken vertices and normals.

Rows "degenerate triangles, missing or NaN normals" and "huge, tiny or far-away scenes" of the table of hazards.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.errors import SceneError
from app.load import load_scene
from app.renderer import Renderer
from app.scene import Camera, CameraPath, Instance, Material, Mesh, PointLight, Scene, bounds_of
from app.settings import Settings
from tests.gl.closed_forms import point_irradiance
from tests.gl.scenes import GREY, Part, box, draw, floor, make_scene, moved, quad
from tests.robustness.scenes import (
    CAMERA,
    EVERYTHING,
    HARD_LAMP,
    LAMP,
    RADIOSITY,
    SIZE,
    assert_same,
    beyond,
    corner,
    lit_corner,
    shown,
)

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

FRONT = Camera((0.0, 0.5, 2.0), (0.0, 0.5, 0.0))
TRIANGLE = Part(np.array([[[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 1.0, 0.0]]]))


def test_one_triangle() -> None:
    """Its area on the screen, and the light of a point on it, by closed form; around it nothing."""
    lamp = PointLight((0.2, 0.6, 1.0), (1.0, 1.0, 1.0))
    images = draw(make_scene([TRIANGLE], [lamp], FRONT), SIZE, (*EVERYTHING, "position"), model=RADIOSITY)
    seen = images["depth"][..., 0] > 0
    pixel = 2 * 2.0 * np.tan(np.radians(FRONT.fov_y_deg / 2)) / SIZE[1]
    assert seen.sum() * pixel**2 == pytest.approx(0.5, rel=0.05)
    reference = 0.5 / np.pi * point_irradiance(images["position"][seen].astype(np.float64), (0, 0, 1), lamp.position)
    np.testing.assert_allclose(images["direct"][seen][:, 1], reference, rtol=2e-3)
    np.testing.assert_array_equal(images["final"], images["direct"])  # it sees only itself, so nothing bounces
    assert not any(images[name][~seen].any() for name in EVERYTHING)


@pytest.mark.parametrize("taa", [False, True])
def test_no_triangle_at_all(taa: bool) -> None:
    """Sky is exactly black, whatever shines in it; files without triangles are refused (tests/unit)."""
    scene = make_scene([], [LAMP], CAMERA)
    with Renderer(scene, Settings(size=SIZE, outputs=EVERYTHING, taa=taa, provider="cpu"), RADIOSITY) as renderer:
        for _ in range(3):
            assert not any(image.any() for image in renderer.render(CAMERA).values())


def test_a_million_triangles_make_the_picture_of_two() -> None:
    side = 708
    at = np.linspace(-1.5, 1.5, side)
    x, z = np.meshgrid(at, at, indexing="ij")
    positions = np.stack([x, np.zeros_like(x), z], axis=-1).reshape(-1, 3).astype(np.float32)
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    triangles = np.concatenate([np.stack([a, a + 1, a + side], 1), np.stack([a + 1, a + side + 1, a + side], 1)])
    many = Mesh("many", positions, np.zeros_like(positions), triangles.astype(np.uint32))
    two = lit_corner(LAMP)
    instances = (Instance("many", 0, np.eye(4)), *two.instances[1:])
    scene = replace(two, meshes=(many, *two.meshes[1:]), instances=instances)
    assert scene.triangles == 2 * (side - 1) ** 2 + 14 > 999_000
    found, expected = shown(scene), shown(two)
    assert np.abs(found["display"].astype(int) - expected["display"]).max() <= 1
    for name in ("final", "direct", "indirect", "depth"):
        assert beyond(found[name], expected[name], 1e-3) == 0, name


def test_two_walls_in_one_plane() -> None:
    """Whichever is drawn first is seen, everywhere and in every frame, and neither shadows the other."""
    wall = quad((-1, 0, 0), (2, 0, 0), (0, 1, 0), Material(albedo=(0.5, 0.25, 0.125)))
    other = replace(wall, material=Material(albedo=(0.1, 0.2, 0.4)))
    for lamp in (HARD_LAMP, LAMP):
        both, one = (shown(make_scene(parts, [lamp], FRONT)) for parts in ([wall, other], [wall]))
        assert both["direct"].max() > 0.01
        for name in ("albedo", "normal", "depth", "direct"):
            np.testing.assert_array_equal(both[name], one[name], name)


def test_walls_in_one_plane_of_other_triangles_never_mix() -> None:
    """Rounding chooses between them texel by texel; the light on either is the same."""
    wall = quad((-1, 0, 0), (2, 0, 0), (0, 1, 0), Material(albedo=(0.5, 0.25, 0.125)))
    turned = quad((1, 0, 0), (0, 1, 0), (-2, 0, 0), Material(albedo=(0.125, 0.25, 0.5)))
    images = draw(make_scene([wall, turned], [HARD_LAMP], FRONT), SIZE, ("albedo", "direct", "depth"))
    seen = images["depth"][..., 0] > 0
    colors = {tuple(c) for c in images["albedo"][seen].tolist()}
    assert colors <= {(0.5, 0.25, 0.125), (0.125, 0.25, 0.5)}
    alone = draw(make_scene([wall], [HARD_LAMP], FRONT), SIZE, ("direct",))["direct"]
    np.testing.assert_allclose(images["direct"][..., 1], alone[..., 1], atol=2e-3 * alone.max())


def test_a_camera_inside_a_wall() -> None:
    """Between the two sides of a slab it sees their backs; no light gets there."""
    slab = box((-1.5, 0.0, -0.55), (3.0, 1.0, 0.1))
    inside = Camera((0.0, 0.5, -0.5), (0.0, 0.5, -3.0))
    images = draw(make_scene([slab, floor(1.5, -0.1)], [HARD_LAMP]), SIZE, ("direct", "depth", "normal"), inside)
    assert np.median(images["depth"]) == pytest.approx(0.05, rel=1e-3)
    assert not images["direct"].any()
    facing = images["normal"][SIZE[1] // 2, SIZE[0] // 2]
    np.testing.assert_allclose(facing, (0, 0, 1), atol=1e-3)


def test_a_camera_in_the_very_plane_of_a_wall() -> None:
    """The wall has no area there: what is behind it is seen as if it were not."""
    wall = quad((-1, 0, 0), (2, 0, 0), (0, 1, 0))
    for target in ((0.0, 0.4, -3.0), (3.0, 0.5, 0.0)):
        camera = Camera((0.0, 0.5, 0.0), target)
        with_wall, without = (draw(make_scene(parts, [HARD_LAMP]), SIZE, ("albedo", "normal", "depth"), camera)
                              for parts in ([floor(3.0), wall], [floor(3.0)]))
        assert_same(with_wall, without)


def mirrored(part: Part) -> tuple[Part, Part]:
    """``part`` under a mirroring matrix, and the mesh that this makes, its winding kept outside."""
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirror[0, 3] = 0.2
    baked = (part.triangles @ mirror[:3, :3].T + mirror[:3, 3])[:, ::-1]
    return replace(part, place=mirror), replace(part, triangles=baked)


def test_a_mirrored_instance_is_the_mirrored_mesh() -> None:
    """Light, highlights, shadow and one-sided emission."""
    glossy = Material(albedo=(0.5, 0.4, 0.3), emission=(0.2, 0.1, 0.0), double_sided=False, specular=(0.04,) * 3,
                      roughness=0.3)
    lamp_shade = quad((0.1, 0.6, 0.0), (0.5, 0.2, 0.0), (0.0, 0.0, 0.3))
    odd = Part(np.concatenate([box((0.1, 0.0, -0.2), (0.3, 0.6, 0.4)).triangles, lamp_shade.triangles]), glossy)
    outputs = (*EVERYTHING, "emission", "specular")
    found, expected = (shown(make_scene([floor(1.5), part], [LAMP], CAMERA), outputs) for part in mirrored(odd))
    assert expected["emission"].max() > 0.1 and expected["specular"].max() > 0
    for name in outputs:
        assert beyond(found[name], expected[name], 2e-3) == 0, name


@pytest.mark.parametrize("corner_of", [0, 2])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_triangle_with_a_broken_vertex_is_left_out(value: float, corner_of: int) -> None:
    """Bit for bit the picture without it, also in shadow maps and in the scene's box."""
    ground = floor(1.5)
    broken = np.concatenate([ground.triangles, ground.triangles[:1] + np.array([0.0, 0.3, 0.0])])
    broken[-1, corner_of, 1] = value
    parts = [replace(ground, triangles=broken, uvs=None), *corner()[1:]]
    assert_same(shown(make_scene(parts, [LAMP], CAMERA)), shown(lit_corner(LAMP)))


def test_an_object_of_broken_vertices_alone_is_left_out() -> None:
    nothing = Part(np.full((2, 3, 3), np.nan))
    assert_same(shown(lit_corner(LAMP, more=(nothing,))), shown(lit_corner(LAMP)))


def test_triangles_without_area_change_nothing() -> None:
    """A point, a line, and a needle of three points in a row."""
    flat = Part(np.array([[[0.5, 0.5, 0.5]] * 3, [[-1, 0.5, 0.5], [1, 0.5, 0.5], [1, 0.5, 0.5]],
                          [[-1, 0.2, 1], [0, 0.4, 1], [1, 0.6, 1]]], np.float64))
    found, expected = shown(lit_corner(LAMP, more=(flat,))), shown(lit_corner(LAMP))
    assert_same(found, expected)


OBJ = "mtllib none.mtl\nv -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nv 0 0.5 0\n"
FACES = "f 1 2 3\nf 1 3 4\n"


@pytest.mark.parametrize("more", [
    "f 1 2 5\nv nan 0 0\nf 1 2 6\n", "f 1 2 5\nv 0 1e400 0\nf 1 2 6\n", "f 1 2 5\nf 1 1 2\nf 5 5 5\n"],
    ids=["nan", "infinite", "no area"])
def test_broken_triangles_of_a_file_are_left_out(more: str, tmp_path: Path) -> None:
    def picture(faces: str) -> dict[str, np.ndarray]:
        (tmp_path / "scene.obj").write_text(OBJ + FACES + faces)
        scene = load_scene(tmp_path / "scene.obj").with_lights(HARD_LAMP)
        return draw(scene, SIZE, ("direct", "normal", "depth"), CAMERA)
    assert_same(picture(more), picture("f 1 2 5\n"))


@pytest.mark.parametrize("normals", ["vn nan 0 0\n", "vn 0 0 0\n", "vn 1e400 0 0\n", "vn 0 -1 0\n"],
                         ids=["nan", "zero", "infinite", "turned"])
def test_broken_normals_of_a_file_become_those_of_the_faces(normals: str, tmp_path: Path) -> None:
    def picture(text: str) -> dict[str, np.ndarray]:
        (tmp_path / "scene.obj").write_text(text)
        scene = load_scene(tmp_path / "scene.obj").with_lights(HARD_LAMP)
        return draw(scene, SIZE, ("direct", "normal", "depth"), CAMERA)
    faces = "f 1//1 2//1 3//1\nf 1//1 3//1 4//1\n"
    found, expected = picture(OBJ + normals + faces), picture(OBJ + FACES)
    for name, image in expected.items():
        np.testing.assert_allclose(found[name], image, atol=1e-3, err_msg=name)


def test_a_file_of_broken_triangles_alone_is_refused(tmp_path: Path) -> None:
    (tmp_path / "scene.obj").write_text("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(SceneError, match="triangle"):
        load_scene(tmp_path / "scene.obj")


@pytest.mark.parametrize(("offset", "scale"), [((0, 0, 0), 1e-3), ((0, 0, 0), 1e3), ((1e6, -1e6, 1e6), 1.0)])
def test_huge_tiny_and_far_away_scenes_make_the_same_picture(offset: tuple[float, float, float], scale: float) -> None:
    """Within 2 of 255 for 99 % of the values: edges of shadows may fall on other texels of their maps."""
    here, there = (shown(scene) for scene in (lit_corner(), moved(lit_corner(), offset, scale)))
    difference = np.abs(here["display"].astype(int) - there["display"].astype(int))
    assert np.mean(difference > 2) < 0.01
    assert there["final"].mean() == pytest.approx(here["final"].mean(), rel=3e-3)
    np.testing.assert_allclose(there["depth"], scale * here["depth"], rtol=1e-4)


def test_a_scene_of_one_mesh_far_from_its_camera_is_seen_at_its_place() -> None:
    """A thousandth of a unit, a million units from the origin: positions are relative to the camera."""
    offset = np.array([1e6, 2e6, -1e6])
    card = quad((-5e-4, -5e-4, 0), (1e-3, 0, 0), (0, 1e-3, 0))
    place = np.eye(4)
    place[:3, 3] = offset
    camera = Camera((1e6, 2e6, -1e6 + 2e-3), tuple(offset))
    mesh = make_scene([card]).meshes[0]
    instances = (Instance("card", 0, place),)
    scene = Scene("far", (mesh,), instances, (GREY,), (), {"main": CameraPath.still(camera)}, "main",
                  bounds_of((mesh,), instances))
    depth = draw(scene, SIZE, ("depth",))["depth"]
    assert depth[SIZE[1] // 2, SIZE[0] // 2] == pytest.approx(2e-3, rel=1e-5)
    pixel = 2 * 2e-3 * np.tan(np.radians(camera.fov_y_deg / 2)) / SIZE[1]
    assert (depth > 0).sum() * pixel**2 == pytest.approx(1e-6, rel=0.05)
