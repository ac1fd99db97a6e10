"""Traced shadows: how much light comes through, how noisy it is, and how fast it follows what changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.gl.frame_state import MotionKind
from app.passes import shadow_rays
from app.passes.shadow_rays import filter_shift
from app.renderer import Renderer
from app.scene import Camera, EmissionPoints, Environment, Light, Material, PointLight, RectLight, Scene, SpotLight
from app.settings import Settings
from export.dataset.scenes.found_emitters import with_found_emitters
from tests.gl.closed_forms import F64
from tests.gl.scenes import F32, Part, box, cellar, draw, floor, make_scene, quad, slide, sphere, without_shadows

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE = (192, 144)
WHITE = (1.0,) * 3
ABOVE = Camera((0.0, 0.9, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 70.0)
PANE_HEIGHT, BAR_HEIGHT, BAR, PITCH = 2.5, 2.0, 0.05, 0.25  # metres


def barred_pane() -> Scene:
    """A pane of 2 m that faces down, with flat bars below it."""
    pane = RectLight((0.0, PANE_HEIGHT, 0.0), (2.0, 0, 0), (0, 0, 2.0), WHITE)
    bars = [quad((x - BAR / 2, BAR_HEIGHT, 2.0), (BAR, 0, 0), (0, 0, -4.0)) for x in bar_positions()]
    return make_scene([floor(3.0), *bars], [pane], ABOVE)


def bar_positions() -> F64:
    return np.arange(-8, 9) * PITCH


def share_behind_bars(at: F64) -> F64:
    """Share of the pane's irradiance on the floor that passes the bars, by midpoints over the pane; at: [N, 3]."""
    s = (np.arange(128) + 0.5) / 128 * 2 - 1
    share, free = np.zeros((2, len(at)))
    for x in s:
        crossing = at[:, 0] + (x - at[:, 0]) * (BAR_HEIGHT / PANE_HEIGHT)
        blocked = (np.abs(crossing[:, None] - bar_positions()) < BAR / 2).any(axis=1)
        square = (x - at[:, :1])**2 + (s - at[:, 2:])**2 + PANE_HEIGHT**2
        weight = (1 / square**2).sum(axis=1)  # both cosines are PANE_HEIGHT / distance
        free += weight
        share += np.where(blocked, 0.0, weight)
    return share / free


def error_behind_bars(frames: int) -> F64:
    scene = barred_pane()
    with Renderer(scene, Settings(SIZE, ("direct", "position"), taa=True)) as renderer:
        for _ in range(frames):
            images = renderer.render(ABOVE)
    free = draw(without_shadows(scene), SIZE, ("direct",))["direct"][..., 1]
    at = images["position"].astype(np.float64)[::4, ::4].reshape(-1, 3)
    return images["direct"][::4, ::4, 1].ravel() / free[::4, ::4].ravel() - share_behind_bars(at)


@pytest.mark.parametrize(("frames", "most"), [(1, 0.005), (40, 0.003)])
def test_light_behind_bars_is_right_and_hardly_noisy(frames: int, most: float) -> None:
    error = error_behind_bars(frames)
    assert error.std() < most
    assert abs(error.mean()) < 3e-3


@pytest.mark.parametrize("is_approximate", [False, True])
@pytest.mark.parametrize(("faint_color", "bright_color"), [(WHITE, WHITE), ((0.2, 0.4, 1.0), (2.0, 1.0, 0.3)),
                                                           ((0.0, 0.0, 1.0), (0.3, 0.3, 0.3))])
def test_a_faint_lamp_beside_a_bright_hidden_one_is_hardly_noisy(
        is_approximate: bool, faint_color: tuple[float, ...], bright_color: tuple[float, ...]) -> None:
    """A board hides a lamp that would give many times the light of the one above the floor."""
    faint = RectLight((0.0, 2.5, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, 0.5), faint_color)
    bright = RectLight((-2.0, 1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), tuple(20 * c for c in bright_color))
    board = quad((-1.0, -0.1, 3.0), (0.0, 3.0, 0.0), (0.0, 0.0, -6.0), Material(albedo=(0.0,) * 3, double_sided=True))
    scene = make_scene([floor(3.0), board], [faint, bright], ABOVE)
    if is_approximate:
        at = (np.stack(np.meshgrid(0.0, np.arange(8), np.arange(8)), axis=-1).reshape(-1, 3) - (0, 3.5, 3.5)) / 8
        normal, intensity = np.float32([[1, 0, 0]] * 64), np.float32([np.array(bright.radiance) / 64] * 64)
        points = EmissionPoints(at.astype(np.float32), normal, intensity, np.full(64, 1 / 64, np.float32),
                                np.full(64, False))
        scene = replace(scene, approximate_lights={bright: points})
    hidden, free = (draw(make_scene([floor(3.0)], [light], ABOVE), SIZE, ("direct",))["direct"][..., 2]
                    for light in (bright, faint))
    share = draw(scene, SIZE, ("direct",))["direct"][..., 2] / free
    print(f"HIDDEN lamp of {np.median(hidden / free):.0f} times the light: {share.mean():.3f}, noise {share.std():.3f}")
    assert abs(share.mean() - 1) < 0.01
    assert share.std() < 0.012


def test_rays_find_a_window_again_after_the_render_scale_has_changed() -> None:
    camera = Camera((2.0, 2.2, 3.0), (2.0, 0.0, 2.6), (0.0, 0.0, -1.0), 60.0)
    with Renderer(cellar(1.0), Settings((512, 384), ("final",), taa=True)) as renderer:
        settled = [renderer.render(camera)["final"][..., 1] for _ in range(24)][-1]
        for scale in (0.5, 1.0):
            renderer.set_render_scale(scale)
            found = [renderer.render(camera)["final"][..., 1] for _ in range(6)][-1]
    is_lit = settled > 0.2 * np.median(settled)
    noise = float((found / np.maximum(settled, 1e-6))[is_lit].std())
    print(f"SCALES changed: noise {noise:.3f}")
    assert noise < 0.02


def test_the_edge_of_a_shadow_has_no_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """A straight edge at a slant, on a grid of 1/3 of the picture."""
    monkeypatch.setattr(shadow_rays, "MAX_RECEIVERS", SIZE[0] * SIZE[1] // 9)
    pane = RectLight((-2.0, 2.0, 0.0), (0.2, 0, 0), (0, 0, 0.2), (50.0,) * 3)
    c, s = np.cos(0.3), np.sin(0.3)
    board = quad((-0.2 - 3 * s, 0.12, 3 * c), (6 * s, 0, -6 * c), (-3 * c, 0, -3 * s))
    scene = make_scene([floor(3.0), board], [pane], ABOVE)
    with Renderer(scene, Settings(SIZE, ("direct",), taa=True)) as renderer:
        for _ in range(17):
            light = renderer.render(ABOVE)["direct"][10:134, :, 1]
    share = light / draw(without_shadows(scene), SIZE, ("direct",))["direct"][10:134, :, 1]
    row = np.arange(len(share))
    last = np.array([np.flatnonzero(values < 0.5)[-1] for values in share])
    edge = last + (0.5 - share[row, last]) / (share[row, last + 1] - share[row, last])
    off = float((edge - np.polyval(np.polyfit(row, edge, 1), row)).std())
    print(f"EDGE {off:.2f} pixels off a line")
    assert off < 0.25


def half_covered_pane(roughness: float = 0.1, x: float = 0.0) -> tuple[Scene, Camera]:
    """A polished floor before a pane whose left half is behind a board, seen from ``x``."""
    polished = Material(roughness=roughness, specular=(0.04,) * 3)
    pane = RectLight((0.0, 1.2, -2.0), (2.0, 0, 0), (0, 2.0, 0), WHITE)
    board = quad((-1.2, 0.1, -1.7), (1.2, 0, 0), (0, 2.2, 0))
    camera = Camera((x, 1.2, 2.0), (x, 0.0, -0.6), fov_y_deg=50.0)
    return make_scene([floor(3.0, material=polished), board], [pane], camera), camera


def shares_of_highlight(scene: Scene, cameras: Sequence[Camera], **settings: object) -> tuple[F32, F32]:
    """Share of the covered and of the open half's highlight that the last of the cameras sees."""
    with Renderer(scene, Settings(SIZE, ("specular", "position"), **settings)) as renderer:  # type: ignore[arg-type]
        for camera in cameras:
            images = renderer.render(camera)
    free = draw(without_shadows(scene), SIZE, ("specular",), camera)["specular"][..., 1].ravel()
    position = images["position"].reshape(-1, 3).astype(np.float64)
    at, edge = (mirrored_points(position, camera, z) for z in (-2.0, -1.7))
    in_pane = (np.abs(at[:, 0]) < 0.85) & (np.abs(at[:, 1] - 1.2) < 0.85) & (np.abs(position[:, 1]) < 1e-4) & (free > 0)
    share = images["specular"][..., 1].ravel() / np.maximum(free, 1e-6)
    covered, is_open = share[in_pane & (edge[:, 0] < -0.15)], share[in_pane & (edge[:, 0] > 0.15)]
    assert min(len(covered), len(is_open)) > 300
    return covered, is_open


def mirrored_points(position: F64, camera: Camera, z: float) -> F64:
    """Where mirrored views of a floor meet the plane of ``z``; position, result: [N, 3]."""
    along = (position - np.asarray(camera.eye)) * (1.0, -1.0, 1.0)
    return position + along * ((z - position[:, 2]) / along[:, 2])[:, None]


@pytest.mark.parametrize(("taa", "frames"), [(False, 1), (True, 1), (True, 24)])
def test_a_polished_floor_mirrors_what_covers_half_of_a_pane(taa: bool, frames: int) -> None:
    """The diffuse light of either half is about the same, so its visibility does not tell highlights."""
    scene, camera = half_covered_pane()
    covered, is_open = shares_of_highlight(scene, [camera] * frames, taa=taa)
    assert covered.mean() < 0.03
    assert np.percentile(covered, 95) < 0.1
    assert is_open.mean() == pytest.approx(1.0, abs=0.03)


def test_a_much_brighter_light_elsewhere_changes_no_highlight() -> None:
    scene, camera = half_covered_pane()
    behind = RectLight((0.0, 1.2, 4.0), (0, 2.0, 0), (2.0, 0, 0), (300.0,) * 3)
    covered, is_open = shares_of_highlight(scene.with_lights(*scene.lights, behind), [camera], taa=False)
    assert covered.mean() < 0.03
    assert is_open.mean() == pytest.approx(1.0, abs=0.03)


def test_highlights_settle_soon_after_the_camera_stops() -> None:
    """Mirror images slide over the floor while it moves, so what was gathered then must not last."""
    path = [half_covered_pane(x=x)[1] for x in np.linspace(-0.6, 0.0, 24)]
    scene, camera = half_covered_pane()
    covered, is_open = shares_of_highlight(scene, [*path, *[camera] * 48], taa=True)
    assert covered.mean() < 0.05
    assert is_open.mean() == pytest.approx(1.0, abs=0.05)


def test_highlights_of_a_faint_pane_beside_a_bright_hidden_lamp_are_hardly_noisy() -> None:
    """Few rays of a broad lobe meet the lamp, and those that do bring most of the light."""
    floor_material = Material(albedo=(0.0,) * 3, roughness=0.5, specular=(0.04,) * 3)
    pane = RectLight((0.0, 1.2, -2.0), (2.0, 0, 0), (0, 2.0, 0), WHITE)
    lamp = RectLight((0.4, 1.2, -1.9), (0.3, 0, 0), (0, 0.3, 0), (60.0,) * 3)
    board = quad((-1.2, 0.9, -1.6), (2.2, 0, 0), (0, 1.3, 0))
    camera = half_covered_pane()[1]
    scene = make_scene([floor(3.0, material=floor_material), board], [pane, lamp], camera)
    with Renderer(scene, Settings(SIZE, ("specular", "position"), taa=True)) as renderer:
        images = [renderer.render(camera) for _ in range(192)]
    still, settled = (images[n - 1]["specular"][..., 1].astype(np.float64) for n in (16, 192))
    x, y, z = np.moveaxis(images[0]["position"], -1, 0)[:3]
    inside = (np.abs(y) < 1e-4) & (np.abs(x) < 0.8) & (z > -1.0) & (z < 0.0)
    noise = float(np.sqrt(np.mean((still / np.maximum(settled, 1e-9) - 1)[inside]**2)))
    print(f"BESIDE a hidden lamp: noise {noise:.3f}")
    assert noise < 0.15


@pytest.mark.parametrize("roughness", [0.1, 0.3, 0.5])
def test_specular_rays_leave_diffuse_shadows_as_they_are(roughness: float) -> None:
    """They take the place of some rays, which must not be those towards one part of the light."""
    scene, _ = half_covered_pane(roughness)
    matte = replace(scene, materials=tuple(replace(m, specular=(0.0,) * 3) for m in scene.materials))
    shiny_light, matte_light = (
        np.mean([draw(s, SIZE, ("direct",), seed=seed)["direct"][..., 1] for seed in range(4)], axis=0)
        for s in (scene, matte))
    free = draw(without_shadows(matte), SIZE, ("direct",))["direct"][..., 1]
    lit = free > 0.05 * free.max()
    error = ((shiny_light - matte_light) / np.maximum(free, 1e-9))[lit]
    assert np.sqrt((error**2).mean()) < 0.012


# Half diagonals or radii of 0.02 to 1.5, from touching a wall to far away, of a box of 2 m.
SIZES_AND_DISTANCES = [(0.02, 0.05), (0.02, 4.0), (0.1, 0.15), (0.1, 1.0), (0.4, 0.45), (0.4, 2.0), (1.5, 1.6),
                       (1.5, 6.0)]
EMISSIVE = ("emissive rectangle", "emissive ball", "emissive cube")


def lights_outside(size: float, distance: float) -> dict[str, Light]:
    x = 1.0 + distance
    return {"sphere": PointLight((x, 0.2, 0.3), WHITE, size),
            "spot": SpotLight((x, 0.2, 0.3), (-1.0, 0.0, 0.0), WHITE, 50.0, 60.0, size),
            "rectangle": RectLight((x, 0.2, 0.3), (0, 0, 1.4 * size), (0, 1.4 * size, 0), WHITE)}


def emissive_meshes_outside(size: float, distance: float) -> dict[str, Part]:
    """A rectangle that faces the box, and a ball and a cube, for which approximate lights stand."""
    x, white = 1.0 + distance, Material(albedo=(0.0,) * 3, emission=WHITE)
    half, cube = 0.7 * size, 1.1 * size
    return {EMISSIVE[0]: quad((x, 0.2 - half, 0.3 - half), (0, 0, 2 * half), (0, 2 * half, 0), white),
            EMISSIVE[1]: sphere((x, 0.2, 0.3), size, 12, white),
            EMISSIVE[2]: box((x - cube / 2, 0.2 - cube / 2, 0.3 - cube / 2), (cube,) * 3, white)}


@pytest.mark.parametrize(("size", "distance"), SIZES_AND_DISTANCES)
@pytest.mark.parametrize("kind", ["sphere", "spot", "rectangle", *EMISSIVE])
def test_no_light_comes_into_a_closed_box(kind: str, size: float, distance: float) -> None:
    closed = box((-1, -1, -1), (2, 2, 2))
    if kind in EMISSIVE:
        scene = with_found_emitters(make_scene([closed, emissive_meshes_outside(size, distance)[kind]]))
    else:
        scene = make_scene([closed], [lights_outside(size, distance)[kind]])
    outside = draw(scene, (64, 48), ("direct",), Camera((3.0, 2.5, 2.5), (1.0, 0.2, 0.3), fov_y_deg=60.0))["direct"]
    assert outside.mean() > 0
    with Renderer(scene, Settings((48, 48), ("direct",), taa=False)) as renderer:
        inside = [renderer.render(Camera((0.0, 0.1, 0.0), target, fov_y_deg=90.0))["direct"].mean() for target in (
            (3.0, 0.1, 0.0), (-3.0, 0.1, 0.0), (0.0, 3.0, 0.01), (0.0, -3.0, 0.01), (0.0, 0.1, 3.0), (0.0, 0.1, -3.0))]
    assert np.mean(inside) <= 1e-3 * outside.mean()


def test_bounces_inside_a_closed_box_are_black_too(small_ember) -> None:
    scene = make_scene([box((-1, -1, -1), (2, 2, 2))], [lights_outside(0.4, 0.45)["rectangle"]])
    inside = draw(scene, (64, 48), ("final",), Camera((0, 0.1, 0), (1, 0, 0.2), fov_y_deg=80.0), small_ember)["final"]
    assert inside.mean() <= 1e-3 * 0.5 / np.pi  # of what a wall that faces the light reflects


@pytest.mark.parametrize("roof", [0.5, 1.0, 3.0])
def test_the_sky_beside_a_roof_is_the_form_factor(roof: float) -> None:
    """Under the edge of a half plane at any height half of an even sky's irradiance is left."""
    even = Environment(np.full((8, 16, 3), 0.6, np.float32))
    scene = replace(make_scene([floor(20.0), quad((-40, roof, 40), (40, 0, 0), (0, 0, -80))]), environment=even)
    camera = Camera((0.0, 0.4 * roof, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 20.0)
    share = draw(scene, SIZE, ("direct",), camera)["direct"][..., 1] / (0.5 * 0.6)
    x = draw(scene, SIZE, ("position",), camera)["position"][..., 0].astype(np.float64)
    expected = 0.5 + 0.5 * x / np.hypot(x, roof)
    assert np.abs(share - expected).mean() < 0.015
    assert share.mean() == pytest.approx(expected.mean(), abs=0.01)


@pytest.mark.parametrize("side", [-1, 1])
def test_lights_and_parts_of_the_sky_that_give_nothing_change_no_choice(side: int) -> None:
    """A wall stands on one half of the horizon, under a sky that is bright on one side; a pane shines away from all."""
    radiance = np.full((8, 16, 3), 0.1, np.float32)
    radiance[2:4, 2 if side < 0 else 10:][:, :4] = 20.0
    sky = Environment(radiance)
    scene = replace(make_scene([floor(3.0), box((0.7, -1, -4), (0.1, 1.8, 8))], [], ABOVE), environment=sky)
    idle = RectLight((0.0, -0.5, 0.0), (2.0, 0, 0), (0, 0, 2.0), WHITE)
    alone, both = (draw(s, SIZE, ("direct",))["direct"].astype(np.float64) for s in (scene, scene.with_lights(idle)))
    assert both.mean() == pytest.approx(alone.mean(), rel=2e-3)
    free = draw(replace(make_scene([floor(3.0)], [], ABOVE), environment=sky), SIZE, ("direct",))["direct"]
    assert abs(alone.mean() / free.mean() - 1) > 0.02  # the wall counts


def test_rays_find_the_near_part_of_a_long_light() -> None:
    """A plate 5 cm below a tube of 12 m, whose light comes from a hundredth of the tube: its estimate and its noise."""
    tube = box((-6, 0.05, -0.01), (12, 0.02, 0.02), Material(albedo=(0.0,) * 3, emission=WHITE))
    scene = with_found_emitters(make_scene([quad((-6, 0, 0.1), (12, 0, 0), (0, 0, -0.2)), floor(20.0), tube]))
    camera = Camera((0.0, 0.04, 0.12), (0.0, 0.0, 0.0), fov_y_deg=40.0)
    estimates = []
    with Renderer(scene, Settings((96, 72), ("direct", "position"))) as renderer:
        for _ in range(16):
            images = renderer.render(camera)
            estimates.append(renderer.resource("shadow_unshadowed")[30:, :, 1])
    at = images["position"][30::6, ::12].reshape(-1, 3).astype(np.float64)
    expected = sum(received_from(points, light, at) for light, points in scene.approximate_lights.items())
    estimate = np.mean(estimates, axis=0)[::6, ::12].ravel()
    assert estimate.mean() == pytest.approx(float(np.mean(expected)), rel=0.05)
    assert np.median([rows.std(axis=1) / rows.mean(axis=1) for rows in estimates]) < 0.1


def received_from(points: EmissionPoints, light: Light, at: F64) -> F64:
    """Unshadowed irradiance of emission points at points that face up."""
    assert isinstance(light, RectLight)
    to = np.asarray(light.center) + points.offset.astype(np.float64) - at[:, None]
    square = (to * to).sum(axis=2)
    emitted, received = np.maximum(-(to * points.normal).sum(axis=2), 0), np.maximum(to[..., 1], 0)
    sent = points.intensity[:, 1] / (square + points.area / np.pi)
    return np.asarray((sent * emitted * received / square).sum(axis=1))


def pass_and_pane() -> tuple[Scene, Camera]:
    """A lid that passes between a pane and a floor."""
    pane = RectLight((0.0, 2.0, 0.0), (1.0, 0, 0), (0, 0, 1.0), WHITE)
    lid = replace(quad((-1, 1.0, 1), (2, 0, 0), (0, 0, -2)), motion=slide([0, 1], [(8, 0, 0), (0, 0, 0)]))
    return make_scene([floor(1.0), lid], [pane], ABOVE), ABOVE


def test_a_shadow_follows_what_casts_it() -> None:
    scene, camera = pass_and_pane()
    with Renderer(scene, Settings(SIZE, ("direct",), taa=True)) as renderer:
        bright = [renderer.render(camera, 0.0)["direct"].mean() for _ in range(20)][-1]
        dark = [renderer.render(camera, 1.0)["direct"].mean() for _ in range(8)][-1]
    assert dark < 0.1 * bright


def test_another_light_shows_within_a_few_frames() -> None:
    """The share of light that arrives is history of the lights before."""
    camera = ABOVE
    left, right = (RectLight((x, 2.0, 0.0), (1.0, 0, 0), (0, 0, 1.0), WHITE) for x in (-2.0, 2.0))
    scene = make_scene([floor(1.0), box((-0.1, 0.3, -0.5), (0.2, 0.2, 1.0))], [left], camera)
    expected: F32 = draw(scene.with_lights(right), SIZE, ("direct",))["direct"]
    with Renderer(scene, Settings(SIZE, ("direct",), taa=True)) as renderer:
        for _ in range(30):
            renderer.render(camera)
        assert renderer.relight((right,))
        for _ in range(8):
            found = renderer.render(camera)["direct"]
    assert np.abs(found - expected).mean() < 0.03 * expected.mean()


def test_nothing_is_left_of_a_light_that_goes_out() -> None:
    """At a size with one ray a texel, a much brighter light leaves no trace in the share of light that arrives."""
    size = (480, 270)
    parts = [floor(1.0), box((-0.1, 0.3, -0.5), (0.2, 0.2, 1.0))]
    bright, dim = (RectLight((x, 2.0, 0.0), (1.0, 0, 0), (0, 0, 1.0), (power,) * 3) for x, power in ((-2, 30), (2, 1)))
    dark = replace(bright, radiance=(0.0,) * 3)
    scene = make_scene(parts, [bright, dim], ABOVE)
    expected = draw(scene.with_lights(dark, dim), size, ("direct",))["direct"]
    with Renderer(scene, Settings(size, ("direct",), taa=True)) as renderer:
        for _ in range(8):
            renderer.render(ABOVE)
        assert renderer.relight((dark, dim))
        for _ in range(8):
            found = renderer.render(ABOVE)["direct"]
    assert np.abs(found - expected).mean() < 0.05 * expected.mean()


def test_wires_before_the_sky_have_its_light() -> None:
    """Thinner than a texel of the grid that shadows are traced on."""
    even = Environment(np.full((8, 16, 3), 0.6, np.float32))
    wires = [quad((x, 0.0, 0.0), (0.012, 0, 0), (0, 2.0, 0)) for x in np.linspace(-1.5, 1.5, 40)]
    camera = Camera((0.0, 1.0, 2.0), (0.0, 1.0, 0.0), fov_y_deg=40.0)
    images = draw(replace(make_scene(wires), environment=even), (800, 400), ("direct", "depth"), camera)
    found = images["direct"][..., 1][images["depth"][..., 0] > 0]
    assert len(found) > 1000
    np.testing.assert_allclose(found, 0.5 * 0.6, rtol=0.05)


def test_what_stands_inside_a_sphere_light_is_lit() -> None:
    light = PointLight((0.0, 0.1, 0.0), WHITE, 0.5)
    scene = make_scene([floor(2.0)], [light])
    share = draw(scene, SIZE, ("direct",), ABOVE)["direct"] / draw(without_shadows(scene), SIZE, ("direct",))["direct"]
    assert share.min() > 0.98


@pytest.mark.parametrize("extent", [5.0, 5000.0])
def test_a_low_lid_shadows_the_floor_also_in_a_large_scene(extent: float) -> None:
    even = Environment(np.full((8, 16, 3), 0.6, np.float32))
    lid = quad((-0.5, 0.05, 0.5), (1, 0, 0), (0, 0, -1))
    camera = Camera((0.0, 0.03, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 40.0)
    scene = replace(make_scene([floor(extent), lid]), environment=even)
    assert draw(scene, SIZE, ("direct",), camera)["direct"].mean() < 0.2 * 0.5 * 0.6


def test_the_picture_says_what_is_traced() -> None:
    large, small = RectLight((0, 2.0, 0), (1.0, 0, 0), (0, 0, 1.0), WHITE), PointLight((0, 2.0, 0), WHITE, 0.01)
    with Renderer(make_scene([floor(1.0)], [large, small]), Settings(SIZE)) as renderer:
        assert renderer.shadow_methods == {"RectLight by rays": 1, "PointLight by shadow map": 1}


@pytest.mark.parametrize("spacing", [1, 3])
def test_filters_of_frames_at_rest_fill_the_gaps_between_their_texels(spacing: int) -> None:
    def shifts(motion: MotionKind, accumulates: bool = True) -> list[tuple[int, int]]:
        frames = [SimpleNamespace(motion=motion, accumulates=accumulates, index=n) for n in range(spacing**2)]
        return [filter_shift(frame, spacing) for frame in frames]  # type: ignore[arg-type]

    reach = range(-(spacing // 2), spacing // 2 + 1)
    assert sorted(shifts(MotionKind.NONE)) == [(x, y) for x in reach for y in reach]
    assert shifts(MotionKind.NONE)[0] == (0, 0)  # a first frame may be the only one
    assert set(shifts(MotionKind.CAMERA)) == set(shifts(MotionKind.NONE, accumulates=False)) == {(0, 0)}
