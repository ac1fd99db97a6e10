"""Environments through the whole renderer: as background, as light by ember, and as the path tracer has them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.environment import radiance_along, sky_light
from app.math3d import View
from app.network.selection import find_model
from app.renderer import Renderer
from app.scene import Camera, Environment, Material, RectLight, Scene
from app.settings import Settings
from tests.gl.closed_forms import polygon_irradiance
from tests.gl.scenes import F32, F64, Part, box, cellar, draw, floor, make_scene, quad, slide, window_irradiance
from tests.override import draw_replaced
from tests.unit.test_environment import compass

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE = (64, 48)
LEVEL = Camera((0.0, 1.0, 4.0), (0.0, 1.0, 0.0), fov_y_deg=70.0)
EVEN_SKY = Environment(np.ones((16, 32, 3), np.float32))
DUSK = Environment(np.linspace([0.3, 0.5, 1.0], [1.2, 0.8, 0.5], 64, dtype=np.float32)[:, None])


def under(environment: Environment | None, *parts: object, camera: Camera = LEVEL) -> Scene:
    return replace(make_scene(parts or (floor(1.0),), camera=camera), environment=environment)  # type: ignore[arg-type]


def rays(camera: Camera, size: tuple[int, int] = SIZE) -> F64:
    """Directions in world space through the pixels' centres, shape (h, w, 3)."""
    w, h = size
    view = View.of(camera, size, 1e-3)
    x, y = np.meshgrid((np.arange(w) + 0.5) / w * 2 - 1, 1 - (np.arange(h) + 0.5) / h * 2)
    towards = np.stack([x * view.half_size[0], y * view.half_size[1], -np.ones_like(x)], axis=-1) @ view.rotation
    return np.asarray(towards / np.linalg.norm(towards, axis=-1, keepdims=True))


def seen_on_the_floor(camera: Camera, size: tuple[int, int]) -> F64:
    """Points of the plane y = 0 that the pixels show, shape (h, w, 3)."""
    towards = rays(camera, size)
    return np.asarray(np.array(camera.eye) - towards * (camera.eye[1] / towards[..., 1:2]))


@pytest.mark.parametrize("rotation", [0.0, 40.0, -400.0])
@pytest.mark.parametrize("target", [(0, 1, 0), (3, 2, 4), (-2, 9, 4.1), (0.1, 1, 9)], ids=str)
def test_the_background_is_the_environment_along_each_ray(target: tuple[float, float, float], rotation: float) -> None:
    environment = replace(compass(16, rotation), radiance=compass(16).radiance + np.float32(0.25))
    camera = replace(LEVEL, target=target)
    found = draw(under(environment), SIZE, ("background", "depth", "final"), camera)
    sky = found["depth"][..., 0] == 0
    expected = radiance_along(environment, rays(camera)[sky])
    np.testing.assert_allclose(found["background"][sky], expected, atol=2e-3)
    np.testing.assert_array_equal(found["final"][sky], found["background"][sky])
    assert not found["background"][~sky].any() and sky.mean() > 0.3


def test_a_scene_without_one_has_no_background_pass() -> None:
    for environment, there in ((None, False), (DUSK, True)):
        with Renderer(under(environment), Settings(SIZE, ("final",))) as renderer:
            assert ("background" in {p.name for p in renderer.plan.passes}) == there
    with Renderer(under(DUSK), Settings(SIZE, ("albedo",))) as renderer:
        assert [p.name for p in renderer.plan.passes] == ["gbuffer"]


@pytest.mark.parametrize(("window", "noise"), [(0.3, 0.5), (1.0, 0.06)])
def test_a_room_has_the_light_of_its_window(window: float, noise: float) -> None:
    """Against the form factor of the hole; few rays that are spread over the sky's light pass it."""
    size = (256, 192)
    camera = Camera((2.0, 3.9, 2.65), (2.0, 0.0, 2.649), fov_y_deg=27.0)
    exact = window_irradiance(seen_on_the_floor(camera, size), window)
    with Renderer(cellar(window), Settings(size, ("direct", "albedo"))) as renderer:
        for frame in range(2):
            images = renderer.render(camera)
            error = images["direct"][..., 0] / images["albedo"][..., 0] * np.pi - exact
            print(f"CELLAR {window}, frame {frame}: {error.mean() / exact.mean():.3f} off on the mean, "
                  f"noise {error.std() / exact.mean():.3f}")
            assert abs(error.mean()) < 0.05 * exact.mean()
            assert error.std() < noise * exact.mean()


def test_a_room_has_the_light_of_its_window_and_its_lamp() -> None:
    """Where rays go to a lamp and few to a sky that is mostly hidden, no texel takes all light for visible."""
    size, camera = (128, 96), Camera((2.0, 3.9, 2.65), (2.0, 0.0, 2.649), fov_y_deg=27.0)
    at = seen_on_the_floor(camera, size)
    lamp = RectLight((2.0, 3.95, 2.0), (1.2, 0.0, 0.0), (0.0, 0.0, 1.2), (200.0,) * 3)
    corners = np.array([(1.4, 3.95, 1.4), (2.6, 3.95, 1.4), (2.6, 3.95, 2.6), (1.4, 3.95, 2.6)])
    exact = window_irradiance(at, 0.3) + 200.0 * polygon_irradiance(at, np.array([0.0, 1.0, 0.0]), corners)
    with Renderer(replace(cellar(0.3), lights=(lamp,)), Settings(size, ("direct", "albedo"), taa=True)) as renderer:
        for _ in range(16):
            images = renderer.render(camera)
    error = images["direct"][..., 0] / images["albedo"][..., 0] * np.pi - exact
    print(f"LAMP {error.mean() / exact.mean():.3f} off on the mean, noise {error.std() / exact.mean():.3f}")
    assert abs(error.mean()) < 0.01 * exact.mean()
    assert error.std() < 0.01 * exact.mean()


Change = Callable[[F32, F32], None]


def ratio_of_changed_texel(share: float, rays: str, change: Change) -> F32:
    """Traced light that arrives on a floor of ``share``; ``change`` gets a texel's visible and unshadowed light."""
    size, camera = (128, 96), Camera((2.0, 3.9, 2.65), (2.0, 0.0, 2.649), fov_y_deg=27.0)
    lamp = RectLight((2.0, 3.95, 2.0), (1.2, 0.0, 0.0), (0.0, 0.0, 1.2), (5.0,) * 3)
    with Renderer(replace(cellar(0.3), lights=(lamp,)), Settings(size, ("direct",), taa=True, rays=rays)) as renderer:
        for _ in range(3):
            renderer.render(camera)
        unshadowed = renderer.resource("shadow_unshadowed").copy()
        visible = unshadowed * share
        visible[..., 3], unshadowed[..., 3] = 64.0, share  # samples, and their mean square where all have one weight
        change(visible[20, 20], unshadowed[20, 20])
        draw_replaced(renderer, [camera], {"shadow_visible": visible, "shadow_unshadowed": unshadowed})
        return np.asarray(renderer.resource("shadow_ratio")[..., 1])


@pytest.mark.parametrize(("share", "factor"), [(0.1, 6.0), (0.35, 1.8)])
@pytest.mark.parametrize("rays", ["cpu", "gpu"])
def test_a_texel_that_alone_has_met_the_sky_does_not_shine(rays: str, share: float, factor: float) -> None:
    """Below a lamp, rays are seldom sent to a sky that is mostly hidden, and then bring much of its light."""
    def brighten(visible: F32, unshadowed: F32) -> None:
        visible[:3] *= factor
        unshadowed[3] *= 3 * factor  # by few samples of much light

    ratio = ratio_of_changed_texel(share, rays, brighten)
    np.testing.assert_allclose(ratio[10:30, 10:30], share, atol=0.06)


def test_a_hidden_sample_of_much_light_leaves_no_dark_dot() -> None:
    def add_hidden_light(visible: F32, unshadowed: F32) -> None:
        unshadowed[:3] *= 1.7

    ratio = ratio_of_changed_texel(0.9, "cpu", add_hidden_light)
    np.testing.assert_allclose(ratio[10:30, 10:30], 0.9, atol=0.07)


def test_a_shadow_of_one_texel_stays() -> None:
    """Its unshadowed light is that of the texels around."""
    def hide(visible: F32, unshadowed: F32) -> None:
        visible[:3] *= 0.1
        unshadowed[3] *= 0.1

    ratio = ratio_of_changed_texel(0.9, "cpu", hide)
    assert ratio[20, 20] < 0.2
    assert ratio[10:19, 10:30].min() > 0.8


def test_a_lamp_does_not_show_the_highlights_of_a_hidden_sky() -> None:
    """A rough floor has as much of the sky's highlights below a lamp as without one: little, through a small window."""
    camera = Camera((2.0, 1.5, 3.9), (2.0, 0.0, 1.0), fov_y_deg=40.0)
    lamp = RectLight((2.0, 3.95, 2.0), (1.2, 0.0, 0.0), (0.0, 0.0, 1.2), (5.0,) * 3)
    room = cellar(1.0)
    room = replace(room, materials=tuple(replace(m, specular=(0.5,) * 3, roughness=0.9) for m in room.materials))

    def highlights(environment: Environment | None, *lights: RectLight) -> float:
        scene = replace(room, environment=environment, lights=lights)
        with Renderer(scene, Settings((128, 96), ("specular",), taa=True)) as renderer:
            return float(np.mean([renderer.render(camera)["specular"].mean() for _ in range(8)][4:]))

    alone, with_lamp = highlights(room.environment), highlights(room.environment, lamp) - highlights(None, lamp)
    print(f"HIGHLIGHTS of the sky {alone:.4f} alone, {with_lamp:.4f} beside a lamp")
    assert abs(with_lamp - alone) < 0.3 * alone


def test_highlights_of_the_sky_come_with_its_light() -> None:
    """A shutter that opens after a while at rest, in a room with a dim lamp."""
    rough = Material(albedo=(0.5,) * 3, specular=(0.5,) * 3, roughness=0.9)
    room = cellar(2.0)
    walls = [Part(mesh.positions.reshape(-1, 3, 3), rough) for mesh in room.meshes]
    opens = slide((0, 1, 1.01, 9), [(0, 0, 0), (0, 0, 0), (0, 40, 0), (0, 40, 0)])
    shutter = quad((0.9, 0.9, -0.05), (2.2, 0, 0), (0, 2.2, 0), motion=opens)
    lamp = RectLight((2.0, 3.95, 2.0), (1.2, 0.0, 0.0), (0.0, 0.0, 1.2), (0.05,) * 3)
    scene = replace(make_scene([*walls, shutter], [lamp]), environment=room.environment)
    camera = Camera((2.0, 1.5, 3.9), (2.0, 0.0, 1.0), fov_y_deg=40.0)

    def highlights(*times: float) -> float:
        with Renderer(scene, Settings((128, 96), ("specular",), taa=True)) as renderer:
            return [float(renderer.render(camera, time)["specular"].mean()) for time in times][-1]

    closed, opened, late = highlights(*[0.5] * 30), highlights(*[2.0] * 4), highlights(*[0.5] * 30, *[2.0] * 4)
    print(f"SHUTTER closed {closed:.4f}, open {opened:.4f}, four frames after it opened {late:.4f}")
    assert closed < 0.2 * opened
    assert abs(late - opened) < 0.1 * opened


def test_a_dim_lamp_leaves_the_shadows_of_the_skys_highlights() -> None:
    rough = Material(albedo=(0.5,) * 3, specular=(0.5,) * 3, roughness=0.8)
    parts = floor(3.0, 0.0, rough), box((-0.4, 0.05, -0.4), (0.8, 0.4, 0.8), rough)
    dim = RectLight((0.0, 3.0, 0.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0), (1e-3,) * 3)
    alone, beside = (draw(replace(under(EVEN_SKY, *parts), lights=lights), SIZE, ("specular",))["specular"]
                     for lights in ((), (dim,)))
    assert np.abs(beside - alone).mean() < 0.01 * alone.mean()


def test_the_light_of_a_shaft_stays_as_it_was() -> None:
    """A third of the sky is visible: frames must not choose by their own rays which estimate they take."""
    walls = [quad((-2, 0, -2), (0, 0, 4), (4, 0, 0)), quad((-2, 0, -2), (0, 3, 0), (0, 0, 4)),
             quad((2, 0, -2), (0, 0, 4), (0, 3, 0)), quad((-2, 0, -2), (4, 0, 0), (0, 3, 0)),
             quad((-2, 0, 2), (0, 3, 0), (4, 0, 0))]
    camera = Camera((0.0, 2.95, 0.001), (0.0, 0.0, 0.0), fov_y_deg=40.0)
    at = seen_on_the_floor(camera, (128, 96))
    rim = np.array([(-2, 3, -2), (2, 3, -2), (2, 3, 2), (-2, 3, 2)])
    exact = polygon_irradiance(at, np.array([0.0, 1.0, 0.0]), rim).mean()
    with Renderer(under(EVEN_SKY, *walls), Settings((128, 96), ("direct", "albedo"))) as renderer:
        means = []
        for _ in range(60):
            images = renderer.render(camera)
            means.append((images["direct"][..., 0] / images["albedo"][..., 0]).mean() * np.pi / exact)
    print(f"SHAFT {means[0]:.4f} of the light, after 60 frames {means[-1]:.4f}")
    assert abs(means[0] - 1) < 0.01
    assert abs(means[-1] - means[0]) < 0.001


def test_a_turning_camera_leaves_no_ghost_of_the_sky() -> None:
    """A sharp edge in the sky is where it is now, not where it was, and a still camera's sky settles."""
    scene = under(replace(compass(32), radiance=np.float32(0.2) + compass(32).radiance))
    with Renderer(scene, Settings(SIZE, ("final", "depth"), taa=True)) as renderer:
        for k in range(12):
            turn = np.radians(4.0 * k)
            camera = replace(LEVEL, target=(4 * np.sin(turn), 1.5, 4 - 4 * np.cos(turn)))
            images = renderer.render(camera)
    plain = draw(scene, SIZE, ("final",), camera)["final"]
    sky = images["depth"][..., 0] == 0
    away = np.abs(images["final"] - plain)[sky].max(axis=1)
    assert np.percentile(away, 99) < 0.12 and away.mean() < 0.01  # 0.5 and 0.02 where the sky is taken to stand still


@pytest.mark.parametrize("height", [1, 64, 2048])
def test_a_large_map_is_averaged_over_pixels(height: int) -> None:
    """Stripes much finer than a pixel are grey, not noise."""
    stripes = np.zeros((height, 4096, 3), np.float32)
    stripes[:, ::2] = 1.0
    found = draw(under(Environment(stripes)), SIZE, ("background", "depth"))
    sky = found["depth"][..., 0] == 0
    np.testing.assert_allclose(found["background"][sky], 0.5, atol=0.01)


def traced(scene: Scene, spp: int, bounces: int = 8) -> dict[str, F32]:
    pytest.importorskip("mitsuba", reason="the path tracer needs mitsuba")
    from export.reference.path_tracer import PathTracer
    from export.reference.still import Still
    from export.reference.trace import mean_samples

    return mean_samples(PathTracer(scene, max_bounces=bounces), Still(scene, scene.cameras["main"].at(0.0), SIZE), spp)


def diffuse_light(images: dict[str, F32]) -> F32:
    """Radiance / albedo of direct and indirect light."""
    return images["direct"] / np.maximum(images["albedo"], 1e-6) + images["indirect"]


@pytest.mark.parametrize("rotation", [0.0, 65.0])
@pytest.mark.parametrize("size", [(1, 4), (8, 32), (300, 75)])
def test_the_path_tracers_sky_is_ours(size: tuple[int, int], rotation: float) -> None:
    """Walls that face each way get what the cells of the map send there; nothing is in between."""
    radiance = np.random.default_rng(1).random((*size, 3), np.float32)
    environment = Environment(radiance ** 4, rotation)
    cells = sky_light(environment, 1)
    for normal in np.array([(0, 0, 1), (0.8, 0, 0.6), (-1, 0, 0.01), (0, 1, 0.01), (0, -1, 0.01)], np.float64):
        normal /= np.linalg.norm(normal)
        side = np.cross([0.2, 0.9, 0.4], normal)
        side /= np.linalg.norm(side)
        up = np.cross(normal, side)
        wall = quad(tuple(-side - up), tuple(2 * side), tuple(2 * up))
        scene = under(environment, wall, camera=Camera(tuple(2 * normal), (0, 0, 0), tuple(up), 30.0))
        found = diffuse_light(traced(scene, 256)).mean(axis=(0, 1))
        expected = np.maximum(normal @ cells.cell.T, 0) @ cells.cell_power / np.pi
        np.testing.assert_allclose(found, expected, rtol=0.02)


def relative_error(found: F32, reference: F32, where: np.ndarray) -> float:
    """Root mean square over texels, relative to the reference's mean."""
    return float(np.sqrt(np.square(found - reference)[where].mean()) / reference[where].mean())


@pytest.fixture(scope="module")
def small(small_ember: Path) -> Path:
    return small_ember


@pytest.mark.parametrize("sun", [False, True])
def test_ember_lights_by_the_environment(small: Path, sun: bool) -> None:
    """A block in a courtyard, under a sky of colours and under a small bright patch; light and its shadows."""
    radiance = np.broadcast_to(DUSK.radiance, (64, 128, 3)).copy()
    if sun:
        radiance[14:17, 38:41] = 400.0
    walls = [quad((-3, 0, -3), (6, 0, 0), (0, 2, 0)), quad((-3, 0, 3), (0, 0, -6), (0, 2, 0))]
    camera = Camera((3.5, 3.0, 4.5), (-0.5, 0.5, -0.5), fov_y_deg=50.0)
    block = box((-0.6, 0.0, -0.6), (1.2, 1.2, 1.2), Material(albedo=(0.6, 0.3, 0.2)))
    scene = under(Environment(radiance, 20.0), floor(3.0), *walls, block, camera=camera)
    images = traced(scene, 512)
    reference, seen = diffuse_light(images), images["depth"][..., 0] > 0
    found = diffuse_light(draw(scene, SIZE, ("direct", "indirect", "albedo"), model=small))
    assert found[seen].mean() == pytest.approx(reference[seen].mean(), rel=0.05)
    assert relative_error(found, reference, seen) < (0.35 if sun else 0.15)


def test_a_mesh_without_triangles_is_drawn_as_sky() -> None:
    scene = under(DUSK)
    empty = replace(scene, meshes=tuple(replace(mesh, triangles=mesh.triangles[:0]) for mesh in scene.meshes))
    with Renderer(empty, Settings(SIZE, provider="cpu"), find_model("final-gather")) as renderer:
        assert renderer.render(LEVEL)["final"].min() > 0.2


def test_lamps_hide_the_sky(small: Path) -> None:
    """The mesh of an analytic light casts no shadow of lights, but is before the sky, for ember and the path tracer."""
    lid = quad((-1, 0.3, 1), (2, 0, 0), (0, 0, -2), Material(albedo=(0.0,) * 3, is_light_proxy=True))
    scene = under(DUSK, floor(1.0), lid, camera=Camera((0, 0.2, 1.6), (0, 0, 0), fov_y_deg=40.0))
    images = traced(scene, 256)
    below = (images["depth"][..., 0] > 0) & (images["albedo"][..., 0] > 0.1)
    reference = diffuse_light(images)[below].mean()
    found = diffuse_light(draw(scene, SIZE, ("direct", "indirect", "albedo"), model=small))
    assert below.sum() > 100 and reference < 0.3 * DUSK.radiance.mean()
    assert found[below].mean() == pytest.approx(reference, rel=0.25)


@pytest.mark.parametrize("radiance", [1e30, 1e-20])
@pytest.mark.parametrize("shape", [(1, 1), (1, 300), (300, 1)])
def test_bright_and_dim_environments_of_any_shape(small: Path, radiance: float, shape: tuple[int, int]) -> None:
    """The picture is that of radiance 1, but for the factor."""
    pictures = []
    for factor in (1.0, radiance):
        even = Environment(np.full((*shape, 3), factor, np.float32))
        scene = under(even, floor(1.0), box((-0.3, 0, -0.3), (0.6,) * 3))
        pictures.append(draw(scene, SIZE, ("final",), model=small)["final"].astype(np.float64) / factor)
    assert pictures[0].min() > 0.05
    np.testing.assert_allclose(pictures[1], pictures[0], rtol=0.02)


def test_what_moves_hides_the_sky(small: Path) -> None:
    """A lid comes over a floor: the floor darkens, and brightens again when it goes."""
    lid = replace(quad((-1, 0.3, 1), (2, 0, 0), (0, 0, -2)), motion=slide([0, 1, 2], [(9, 0, 0), (0, 0, 0), (9, 0, 0)]))
    scene = under(DUSK, floor(1.0), lid, camera=Camera((0, 0.9, 2.2), (0, 0, 0), fov_y_deg=40.0))
    with Renderer(scene, Settings(SIZE, ("direct", "position"), taa=False, provider="cpu"), small) as renderer:
        light = []
        for time in (0.0, 1.0, 2.0):
            images = renderer.render(scene.cameras["main"].at(0.0), time)
            at = np.abs(images["position"])
            on_floor = (at[..., 1] < 0.01) & (at[..., ::2].max(axis=-1) < 0.5)
            light.append(images["direct"][on_floor].mean())
    assert light[1] < 0.4 * light[0] and light[2] == pytest.approx(light[0], rel=0.02)
