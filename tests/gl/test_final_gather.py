"""Final gathering through the whole renderer: its passes, closed boxes, contact shadows, light over time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from app.network.selection import find_model
from app.passes import gather_turns
from app.radiance_scale import radiance_scale
from app.raycast.caster import Caster
from app.renderer import Renderer
from app.scene import Camera, Material, RectLight, Scene, Texture
from app.settings import Settings
from app.surfels.final_gather import LightAt, gather, sequence
from tests.gl.scenes import GREY, Part, box, floor, make_scene, quad

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

MODEL = find_model("final-gather")
SIZE = (128, 96)
WHITE = Material(albedo=(0.7,) * 3)
LAMP = RectLight((-0.5, 2.9, -0.5), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (8.0,) * 3)
CAMERA = Camera((0.0, 1.0, 1.9), (0.0, 0.2, 0.0), fov_y_deg=55)


def table_in_a_room() -> Scene:
    """A board just above the floor of a white room: little light gets below it."""
    return make_scene([box((-2, 0, -2), (4, 3, 4), WHITE), box((-0.5, 0.12, -0.5), (1.0, 0.05, 1.0), WHITE)], [LAMP],
                      CAMERA)


def settings(*outputs: str, taa: bool = True) -> Settings:
    return Settings(SIZE, outputs, taa=taa, provider="cpu")


@pytest.fixture(scope="module")
def table(egl: None) -> Iterator[Renderer]:
    with Renderer(table_in_a_room(), settings("indirect", "position", "normal"), MODEL) as renderer:
        yield renderer


def settled(renderer: Renderer, camera: Camera, frames: int = 48) -> dict[str, NDArray[np.float32]]:
    renderer.cut()
    for _ in range(frames):
        renderer.advance(camera)
    return renderer.render(camera)


def relative_error(light: NDArray[np.float32], reference: NDArray[np.float32]) -> float:
    """Root of the mean square, relative to the mean."""
    return float(np.sqrt(((light - reference) ** 2).mean()) / reference.mean())


def test_only_a_network_that_reads_gathered_light_has_its_passes() -> None:
    scene = make_scene([floor(1.0)], [LAMP])
    names = {}
    for model in ("ember", "final-gather"):
        for taa in (True, False):
            with Renderer(scene, settings("final", taa=taa), find_model(model)) as renderer:
                names[model, taa] = {p.name for p in renderer.plan.passes}
                culled = renderer.plan.culled
    passes = {"gather_rays", "gather_history", "surfel_indirect"}
    assert not passes & (names["ember", True] | names["ember", False])
    assert passes <= names["final-gather", True]
    assert names["final-gather", False] & passes == passes - {"gather_history"}
    assert "no-taa" in culled["gather_history"]


def test_a_closed_glowing_box_is_uniform() -> None:
    """Every surface emits 1 and reflects 0.6, so 1 / (1 − 0.6) arrives everywhere."""
    glowing = Material(albedo=(0.6,) * 3, emission=(1.0,) * 3)
    scene = make_scene([box((-2, 0, -2), (4, 3, 4), glowing), box((-0.5, 0.0, -0.5), (0.6, 0.9, 0.6), glowing)], (),
                       CAMERA)
    with Renderer(scene, settings("indirect"), MODEL) as renderer:
        light = renderer.render(CAMERA)["indirect"]
    np.testing.assert_allclose(light, 2.5, rtol=0.03)
    np.testing.assert_allclose(light.mean(), 2.5, rtol=0.01)


def test_thin_things_keep_light_while_the_camera_moves() -> None:
    """Bars narrower than a texel of the grid, which have just come into view there in most frames."""
    bars = [quad((-0.9 + 0.3 * k, 0.0, -0.3), (0.004 * side, 0.0, -0.004), (0.0, 2.0, 0.0), WHITE)
            for k in range(7) for side in (-1, 1)]
    scene = make_scene([box((-2, 0, -2), (4, 3, 4), WHITE), *bars], [LAMP], CAMERA)
    with Renderer(scene, Settings((1024, 768), ("indirect", "position"), provider="cpu"), MODEL) as renderer:
        darkest = []
        for frame in range(6):
            x = 0.02 * frame
            images = renderer.render(Camera((x, 1.0, 1.9), (x, 0.7, 0.0), fov_y_deg=55))
            on_bars = np.abs(images["position"][..., 2] + 0.302) < 0.004
            light = images["indirect"].mean(axis=-1)
            assert on_bars.sum() > 1000
            darkest.append(np.quantile(light[on_bars], 0.02) / np.median(light[on_bars]))
    print("THIN bars: darkest 2 %", np.round(darkest, 2))
    assert min(darkest[2:]) > 0.2


def test_the_floor_below_a_board_is_as_dark_as_many_rays_say(table: Renderer) -> None:
    """1024 rays that end at the same surfels. Texels as wide as two pixels average across the board's edge."""
    images = settled(table, CAMERA)
    on_floor = (images["normal"][..., 1] > 0.9) & (images["position"][..., 1] < 0.01)
    x, z = (np.abs(images["position"][..., axis]) for axis in (0, 2))
    rows = np.flatnonzero((on_floor & (np.maximum(x, z) < 1.0)).ravel())[::7]
    below = np.maximum(x, z).ravel()[rows] < 0.45
    expected = many_rays(table, images["position"].reshape(-1, 3)[rows])
    found = images["indirect"].reshape(-1, 3)[rows, 0]
    assert below.sum() > 20 and (~below).sum() > 20
    assert expected[below].mean() < 0.5 * expected[~below].mean()
    np.testing.assert_allclose(found[below].mean(), expected[below].mean(), rtol=0.25)
    np.testing.assert_allclose(found[~below].mean(), expected[~below].mean(), rtol=0.05)


def many_rays(renderer: Renderer, points: NDArray[np.float32], rays: int = 1024) -> NDArray[np.float32]:
    """Light at points of the floor: direct light of the lamp by its points, indirect light of the newest surfels."""
    surfels, scale = renderer.surfels, radiance_scale(renderer.scene)
    indirect = np.ascontiguousarray(renderer.resource("surfel_indirect").T) / np.float32(scale)
    caster, lookup = surfels.caster, surfels.lookup
    up = np.tile(np.array([[0, 1, 0]], np.float32), (len(points), 1))
    origin = (points - caster.origin).astype(np.float32) + caster.ray_epsilon * up
    numbers = np.broadcast_to(sequence((1, 1), np.zeros(1, np.int64), 0, rays, 0.25), (len(points), rays, 2))
    light_at = LightAt(lambda at, facing: lamp_light(caster, at, facing),
                       lambda at, facing: lookup.approximate(indirect, at, facing))
    return gather(caster, light_at, 0.3, origin, up, numbers).light.mean(axis=1)[:, 0]


def lamp_light(caster: Caster, position: NDArray[np.float32], normal: NDArray[np.float32]) -> NDArray[np.float32]:
    """Irradiance / π by ``LAMP``, which faces up, from eight random points of it."""
    light = np.zeros(len(position), np.float32)
    for across in np.random.default_rng(0).uniform(-0.5, 0.5, (8, len(position), 2)):
        at = np.asarray(LAMP.center) + across[:, :1] * LAMP.edge_u + across[:, 1:] * LAMP.edge_v
        vector = (at - caster.origin - position).astype(np.float32)
        square = (vector**2).sum(axis=1)
        cosines = np.maximum((vector * normal).sum(axis=1), 0) * np.maximum(-vector[:, 1], 0) / square
        seen = ~caster.is_occluded(position + 1e-3 * normal, 0.999 * vector, False)
        light += seen * cosines / square / 8
    return np.outer(light * np.float32(LAMP.radiance[0] / np.pi), np.ones(3, np.float32))


def test_rays_of_many_frames_bring_the_light_nearer_to_where_it_settles(table: Renderer) -> None:
    reference = settled(table, CAMERA, 200)["indirect"]
    errors = {frames: relative_error(settled(table, CAMERA, frames)["indirect"], reference) for frames in (0, 8, 48)}
    assert errors[48] < errors[8] < errors[0]
    assert errors[0] < 0.1


def test_a_moving_camera_leaves_no_light_behind(table: Renderer) -> None:
    """Below and beside the board, whose light differs, as it passes before the floor and the wall."""
    step = 0.03
    table.cut()
    for frame in range(13):
        camera = Camera((step * (frame - 12), 1.0, 1.9), (step * (frame - 12), 0.2, 0.0), fov_y_deg=55)
        moving = table.render(camera)["indirect"]
    still = settled(table, camera, 48)["indirect"]
    assert relative_error(moving, still) < 0.08
    assert abs(float(moving.mean() / still.mean()) - 1) < 0.02


def test_texels_take_turns_where_not_all_can_trace_rays_in_each_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    few = replace(gather_turns.RAYS, rays=64 * 48 // 4)
    monkeypatch.setattr(gather_turns, "RAYS", few)
    monkeypatch.setattr(gather_turns, "AT_REST", few)
    with Renderer(table_in_a_room(), settings("indirect"), MODEL) as renderer:
        renderer.advance(CAMERA)
        first = renderer.resource("gathered_light")
        traced = []
        for _ in range(4):
            renderer.advance(CAMERA)
            traced.append(renderer.resource("gathered_light_now")[..., 3] > 0)
        light, surfels = renderer.resource("gathered_light"), renderer.resource("gathered_surfels")
    assert all(t.mean() == 0.25 for t in traced)
    assert np.sum(traced, axis=0).min() == 1
    np.testing.assert_allclose(light[..., 3], first[..., 3] + 1, rtol=1e-3)
    assert (surfels[..., :3] > 0).all()


def test_every_texel_traces_rays_when_the_light_has_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gather_turns, "RAYS", replace(gather_turns.RAYS, changed_rays=64 * 48 // 4))
    with Renderer(table_in_a_room(), settings("indirect"), MODEL) as renderer:
        for brightness in (8.0, 4.0, 2.0):
            assert renderer.relight((replace(LAMP, radiance=(brightness,) * 3),))
            renderer.advance(CAMERA)
            assert (renderer.resource("gathered_light")[..., 3] >= 1).all()


def test_two_renderers_agree_to_the_bit() -> None:
    def frames() -> NDArray[np.float32]:
        with Renderer(table_in_a_room(), settings("indirect"), MODEL) as renderer:
            renderer.advance(CAMERA)
            return renderer.render(CAMERA)["indirect"]

    np.testing.assert_array_equal(frames(), frames())


@pytest.mark.parametrize("emitted, left", [(2.0, False), (0.002, True)])
def test_the_grid_shows_no_lamps_but_what_hardly_glows(emitted: float, left: bool) -> None:
    """A screen whose left half shines, more or less than the lamp lights it; its right half is black as compressed."""
    pixels = np.full((1, 2, 4), 255, np.uint8)
    pixels[0, 1, :3] = 3
    screen = Material(albedo=(0.5,) * 3, emission=(emitted,) * 3, emission_map=Texture(pixels, magnified="nearest"),
                      is_light_proxy=True)
    scene = make_scene([quad((-3.0, -3.0, 0.0), (6.0, 0.0, 0.0), (0.0, 6.0, 0.0), screen)], [LAMP],
                       Camera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), fov_y_deg=55))
    with Renderer(scene, settings("indirect"), MODEL) as renderer:
        renderer.render(scene.cameras["main"].at(0.0))
        is_seen = renderer.resource("lowres_gbuffer")[..., 3] > 0
    half = is_seen.shape[1] // 2
    assert (is_seen[:, :half - 1] == left).all() and is_seen[:, half + 1:].all()


@pytest.mark.parametrize("model, low, high", [("ember", 0.6, 1.4), ("final-gather", 0.85, 1.2)])
def test_bars_before_a_bright_pane_have_their_own_light(model: str, low: float, high: float) -> None:
    """Much light arrives at the pane, 5 cm behind; without it, where its rectangle still shines, bars get the same."""
    def light_of_bars(*pane: Part) -> NDArray[np.float32]:
        bars = box((-1.0, 1.27, -0.95), (2.0, 0.03, 0.02), GREY), box((-0.015, 0.5, -0.95), (0.03, 1.6, 0.02), GREY)
        scene = make_scene([box((-2.5, 0.0, -3.5), (5.0, 2.6, 6.5), GREY), *bars, *pane],
                           [RectLight((0.0, 1.3, -1.0), (2.0, 0.0, 0.0), (0.0, 1.6, 0.0), (5.0,) * 3)])
        camera = Camera((0.6, 1.4, 2.6), (0.0, 1.2, -1.0), fov_y_deg=60)
        names = "indirect", "position", "normal"
        with Renderer(scene, Settings((800, 600), names, provider="cpu"), find_model(model)) as renderer:
            images = settled(renderer, camera, 11)
        is_front = (np.abs(images["position"][..., 2] + 0.93) < 0.004) & (images["normal"][..., 2] > 0.9)
        assert is_front.sum() > 2000
        return images["indirect"][is_front].mean(axis=-1)

    shining = Material(albedo=(0.0,) * 3, emission=(5.0,) * 3, is_light_proxy=True)
    found = light_of_bars(quad((-1.0, 0.5, -1.0), (2.0, 0.0, 0.0), (0.0, 1.6, 0.0), shining)) / light_of_bars().mean()
    print(f"PANE {model}: bars before it {found.mean():.2f}, from {np.quantile(found, 0.02):.2f} "
          f"to {np.quantile(found, 0.98):.2f} of their light")
    assert abs(found.mean() - 1) < 0.1
    assert low < np.quantile(found, 0.02) and np.quantile(found, 0.98) < high
