"""Skins and morph targets in pictures: motion vectors, shadows, history."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion
from typer.testing import CliRunner

from app.animation.deformation import Deformation, Vertices
from app.animation.track import Track
from app.cli import cli
from app.io.image import read_exr
from app.math3d import View
from app.raycast.caster import Caster
from app.renderer import Renderer
from app.scene import Camera, Light, Material, PointLight, RectLight, Scene
from app.settings import Settings
from tests.deforming import SHAPES, corners_of, deform, deforming_scene, material_points, skin_of, strip
from tests.gl.scenes import Images, draw, floor, make_scene, quad
from tests.unit.load_helpers import Gltf
from tests.unit.test_load_animation import animate

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

SIZE = (256, 192)
FRAME = 1 / 30
KINDS = ["skin", "morph"]
CAMERA = Camera((0.7, 1.3, 3.0), (-0.2, 1.0, 0.0), fov_y_deg=50.0)
LAMP = PointLight((0.8, 3.5, 2.5), (25.0,) * 3)
PANE = RectLight((0.6, 2.8, 0.9), (0.3, 0, 0.3), (0, 0.3, -0.3), (60.0,) * 3, two_sided=True)


def frames(scene: Scene, times: list[float], outputs: tuple[str, ...], cameras: list[Camera]) -> list[Images]:
    with Renderer(scene, Settings(size=SIZE, outputs=outputs, taa=False, provider="cpu")) as renderer:
        return [renderer.render(camera, time) for camera, time in zip(cameras, times, strict=True)]


def pixels_of(points: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
    """Where world-space points, shape (N, 3), are in the picture: x right, y down."""
    clip = View.of(camera, SIZE, 0.01).clip_from_relative()
    projected = np.concatenate([points - np.asarray(camera.eye), np.ones((len(points), 1))], axis=1) @ clip.T
    return (projected[:, :2] / projected[:, 3:] * [0.5, -0.5] + 0.5) * SIZE


@pytest.mark.parametrize("moving_camera", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_motion_vectors_are_differences_of_projected_points(kind: str, moving_camera: bool) -> None:
    scene = deforming_scene(kind, [], [LAMP])
    before, now = 0.5, 0.5 + FRAME
    other = Camera((0.75, 1.28, 2.95), (-0.2, 1.0, 0.0), fov_y_deg=50.0) if moving_camera else CAMERA
    _, images = frames(scene.scene, [before, now], ("position", "motion", "depth"), [other, CAMERA])
    seen = binary_erosion(images["depth"][..., 0] > 0)
    points = images["position"][seen].astype(np.float64)
    triangles = scene.scene.meshes[0].triangles
    shapes = [SHAPES[kind](scene.positions, time)[triangles] for time in (now, before)]
    previous, found = material_points(points, *shapes)
    assert found.mean() > 0.95 and found.sum() > 1000
    expected = pixels_of(points, CAMERA) - pixels_of(previous, other)
    error = np.abs(images["motion"][seen] - expected)[found]
    print(f"MOTION {kind} camera={moving_camera}: error max {error.max():.4f} px, "
          f"motion up to {np.abs(expected[found]).max():.1f} px")
    assert np.abs(expected[found]).max() > 1
    assert error.max() <= 0.05


@pytest.mark.parametrize("kind", KINDS)
def test_a_part_that_holds_its_shape_has_no_motion(kind: str) -> None:
    scene = deforming_scene(kind, [], [LAMP])
    *_, held, again = frames(scene.scene, [0.4, 0.5, 0.5, 0.5], ("motion",), [CAMERA] * 4)
    assert not held["motion"].any() and not again["motion"].any()


def test_a_morph_target_may_change_normals_alone() -> None:
    scene = make_scene([strip(Material())], [LAMP], CAMERA)
    base = Vertices(corners_of(scene, 0), np.tile((0.0, 0.0, 1.0), (len(corners_of(scene, 0)), 1)))
    target = Vertices(np.zeros_like(base.positions), np.tile((1.0, 0.0, 0.0), (len(base.positions), 1)))
    weights = Track(np.array([0.0, 1.0]), np.array([[[0.0]], [[1.0]]]))
    tilting = deform(scene, 0, Deformation(base, (target,), weights, None, np.array([0.0, 1.0]))).scene
    first, last = frames(tilting, [0.0, 1.0], ("normal",), [CAMERA] * 2)
    for image, expected in ((first, (0.0, 0.0, 1.0)), (last, (np.sqrt(0.5), 0.0, np.sqrt(0.5)))):
        seen = image["normal"][image["normal"].any(axis=2)]
        np.testing.assert_allclose(seen, np.tile(expected, (len(seen), 1)), atol=2e-3)
    caster = Caster(tilting)
    before = caster.revision
    caster.move_to(0.5)
    assert caster.revision > before


def test_a_frame_deforms_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also in a parallel view, whose far plane depends on where anything is at any time."""
    scene = deforming_scene("skin", [], [LAMP]).scene
    times: list[float] = []
    vertices_at = Deformation.vertices_at

    def recorded(deformation: Deformation, time: float) -> Vertices:
        times.append(time)
        return vertices_at(deformation, time)

    monkeypatch.setattr(Deformation, "vertices_at", recorded)
    with Renderer(scene, Settings(size=(32, 24), provider="cpu")) as renderer:
        for time in (0.0, 0.25, 0.5):
            times.clear()
            renderer.render(replace(CAMERA, orthographic_height=3.0), time)
    assert times == [0.5]


@pytest.mark.parametrize("light", [LAMP, PANE], ids=["map", "rays"])
@pytest.mark.parametrize("kind", KINDS)
def test_light_and_shadows_follow(kind: str, light: Light) -> None:
    """The picture is that of a still scene in the same shape."""
    others = [floor(3.0), quad((-3, 0, -1), (6, 0, 0), (0, 4, 0))]
    scene = deforming_scene(kind, others, [light], CAMERA)
    first, _, last = frames(scene.scene, [0.0, 0.3, 0.8], ("direct", "albedo"), [CAMERA] * 3)
    still = draw(scene.still(SHAPES[kind](scene.positions, 0.8)), SIZE, ("direct", "albedo"))
    behind = (still["albedo"][..., 1] > 0.4) & (first["albedo"][..., 1] > 0.4)  # floor and wall
    change = (np.abs(first["direct"] - still["direct"]).max(-1) / still["direct"].max(-1).clip(1e-3))[behind]
    error = np.abs(last["direct"] - still["direct"]).max(-1)
    edge = binary_dilation(np.abs(last["albedo"] - still["albedo"]).max(-1) > 0.01)
    wrong = np.mean(error[~edge] > 0.05 * still["direct"].max())
    print(f"SHADOW {kind} {type(light).__name__}: {np.mean(change > 0.1):.1%} changed, {wrong:.3%} differ")
    assert (change > 0.1).mean() > 0.005  # the shadow has moved
    assert wrong < 0.002
    assert edge.mean() < 0.01


def test_faces_turn_with_the_skin() -> None:
    """Face normals and those of the vertices are in the bent shape."""
    scene = deforming_scene("morph", [], [LAMP])
    last = frames(scene.scene, [0.0, 1.0], ("normal", "depth"), [CAMERA] * 2)[1]
    still = draw(scene.still(SHAPES["morph"](scene.positions, 1.0)), SIZE, ("normal", "depth"), CAMERA)
    np.testing.assert_allclose(last["normal"], still["normal"], atol=2e-3)
    np.testing.assert_allclose(last["depth"], still["depth"], atol=1e-4)


def swinging(casts: bool) -> Scene:
    """A strip whose upper half swings by up to six texels a frame before a wall."""
    bright = Material(albedo=(0.9, 0.2, 0.1), is_light_proxy=not casts)
    wall = quad((-3, -1, -1.0), (6, 0, 0), (0, 4, 0), Material(albedo=(0.5, 0.5, 0.5)))
    scene = make_scene([strip(bright), wall], [PointLight((0.5, 3.0, 3.0), (12.0,) * 3, 0.1)],
                       Camera((0.0, 1.0, 3.0), (-0.3, 1.1, 0.0)))
    return deform(scene, 0, skin_of(corners_of(scene, 0), 2.4, period=2.0)).scene


def film(scene: Scene, cut: bool) -> list[Images]:
    settings = Settings(size=SIZE, outputs=("final", "albedo"), provider="cpu")
    with Renderer(scene, settings) as renderer:
        found = []
        for frame in range(20, 44):
            if cut:
                renderer.cut()
            found.append(renderer.render(scene.cameras["main"].at(0.0), frame * FRAME))
        return found


@pytest.mark.parametrize("casts", [False, True])
def test_a_swinging_figure_leaves_no_trail(casts: bool) -> None:
    """Against renders without history, where the figure was up to ten frames ago; not where shadows change."""
    scene = swinging(casts)
    since, changed = np.full(SIZE[::-1], 1000), np.full(SIZE[::-1], 1000)
    errors: list[float] = []
    before = None
    for images, reference in zip(film(scene, cut=False), film(scene, cut=True), strict=True):
        final = reference["final"]
        since = np.where(binary_dilation(reference["albedo"][..., 0] > 0.7, iterations=2), 0, since + 1)
        if before is not None:
            moved = np.abs(final - before).max(-1) > 0.02 * final.max(-1)
            changed = np.where(binary_dilation(moved, iterations=2), 0, changed + 1)
        trail = (since >= 2) & (since <= 10) & ((changed >= since - 1) | (not casts))
        error = np.abs(images["final"] - final).max(-1) / final.max(-1).clip(1e-3)
        errors += error[trail].tolist()
        before = final
    print(f"TRAIL casts={casts}: {len(errors)} texels, p99 {np.percentile(errors, 99):.2%}, max {max(errors):.2%}")
    assert len(errors) > 5000
    assert np.percentile(errors, 99) <= 0.02


def test_a_scene_without_deformation_has_no_attribute_for_it() -> None:
    deforming = deforming_scene("skin", [], [LAMP])
    scene = deforming.still(deforming.positions)
    with Renderer(scene, Settings(size=(16, 12), outputs=("motion",), taa=False, provider="cpu")) as renderer:
        for batch in renderer._geometry.batches:
            assert set(batch.buffers.attributes) == {"in_position", "in_normal"}
            assert "DEFORMED" not in batch.surface.features


def test_a_still_at_a_time_is_the_frame_of_a_film(tmp_path: Path) -> None:
    gltf = Gltf()
    animate(gltf, 0, "translation", [[0, 0, 0], [1, 0.5, 0]], name="slide")
    options = [str(gltf.save(tmp_path)), "--animation", "slide", "--size", "64x48", "--model", "none", "--no-taa",
               "--format", "exr"]
    for name, more in (("film", ["--frames", "4"]), ("still", ["--time", "0.1"])):
        assert CliRunner().invoke(cli, [*options, *more, "--out", str(tmp_path / name)]).exit_code == 0
    film, still = read_exr(tmp_path / "film" / "0003.exr"), read_exr(tmp_path / "still" / "0000.exr")
    np.testing.assert_array_equal(film[""], still[""])
    assert (film[""] != read_exr(tmp_path / "film" / "0000.exr")[""]).any()


@pytest.mark.parametrize("options", [["--animation", "walk"], ["--animation", "walk", "box.gltf"]])
def test_an_animation_that_is_not_there_is_one_line(tmp_path: Path, options: list[str]) -> None:
    Gltf().save(tmp_path, "box.gltf")
    options = [str(tmp_path / o) if o == "box.gltf" else o for o in options]
    done = CliRunner().invoke(cli, ["render", *options])
    assert done.exit_code == 2 and ("--animation" in done.output or "has no animation" in done.output)
