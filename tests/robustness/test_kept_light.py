"""Which indirect light is kept, and which reaches a pixel, where all that a pass reads is given.

Each test is about one or more guards of ``accumulate.frag`` and ``upsample.frag``, see ``guards.toml``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from app.gl.frame_state import MAX_HISTORY, MotionKind
from app.network.channels import HALF_MAX
from app.network.selection import find_model
from app.passes import upsample
from app.renderer import Renderer
from app.scene import Camera
from app.settings import Settings
from tests.gl.scenes import make_scene, quad
from tests.override import Value, draw_replaced

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

Image = NDArray[np.float32]
SIZE = WIDTH, HEIGHT = 256, 192
STEP = 4                           # pixels of a texel of the grid, which sees the one in the middle
GRID = HEIGHT // STEP, WIDTH // STEP
AWAY = 20.0                        # distance of the wall
CAMERA = Camera((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), fov_y_deg=90)
WALL = make_scene([quad((-30, -30, -AWAY), (60, 0, 0), (0, 60, 0))], camera=CAMERA)
TOWARDS, ASIDE = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)  # normals
FRAMES = 16.0
MIDDLE = GRID[1] // 2              # column
KEPT = 1 - 1 / MAX_HISTORY[MotionKind.CAMERA]  # of the light of a pixel that the grid misses
NO_NUMBERS = [np.nan, np.inf, -np.inf, -100.0]
MISSED = {"lowres_gbuffer": np.array((*ASIDE, AWAY))}  # as if the grid showed none of the wall


def drawn(resource: str, *frames: Mapping[str, Value], model: str = "gather", cut: bool = False) -> Image:
    """What a pass writes in the last of some frames of a wall, each of which has other resources replaced."""
    with Renderer(WALL, Settings(SIZE, ("indirect",), provider="cpu"), find_model(model)) as renderer:
        for replaced in frames:
            if cut:
                renderer.cut()
            draw_replaced(renderer, [CAMERA], replaced)
        return renderer.resource(resource)


def history(light: ArrayLike, frames: ArrayLike = FRAMES) -> Image:
    """Accumulated light of the grid, shape (h, w, 4)."""
    image = np.empty((*GRID, 4), np.float32)
    image[..., :3], image[..., 3:] = light, frames
    return image


def surfaces(normal: ArrayLike, depth: ArrayLike) -> Image:
    """What the grid shows, shape (h, w, 4)."""
    return history(normal, depth)


def split(left: float, right: float) -> Image:
    """Numbers left of the middle column and from there on, shape (w, 1)."""
    return np.where(np.arange(GRID[1]) < MIDDLE, left, right)[:, None].astype(np.float32)


def moved(pixels: float, nearer: float = 1.0) -> Value:
    """Motion to the right, and the depth before divided by that now; what else it says stays."""
    return lambda motion: np.concatenate([np.broadcast_to((pixels, 0, nearer), (*motion.shape[:2], 3)),
                                          motion[..., 3:]], axis=2)


def with_light(light: float) -> Value:
    """The light of pixels; what else is written with it stays."""
    return lambda image: np.where(np.arange(4) < 3, np.float32(light), image)


def test_light_of_the_grid_is_kept() -> None:
    """Otherwise the tests below would prove nothing."""
    light = drawn("indirect_low", {"indirect_low": history(2.0)}, {"indirect_now": 1.0})
    np.testing.assert_array_equal(light[..., 3], FRAMES + 1)
    np.testing.assert_allclose(light[..., :3], 2 - 1 / (FRAMES + 1), rtol=1e-6)


@pytest.mark.parametrize("value", NO_NUMBERS)
def test_new_light_that_is_no_number_is_none(value: float) -> None:
    now = history(1.0)
    now[5, 7] = value
    light = drawn("indirect_low", {"indirect_low": history(1.0)}, {"indirect_now": now})
    assert np.isfinite(light).all() and light.min() >= 0 and light.max() <= HALF_MAX


@pytest.mark.parametrize(("light", "frames"), [(np.nan, FRAMES), (np.inf, FRAMES), (-np.inf, FRAMES), (2.0, np.nan),
                                               (2.0, np.inf), (2.0, 0.5), (2.0, -100.0)])
def test_broken_light_of_the_grid_is_dropped(light: float, frames: float) -> None:
    found = drawn("indirect_low", {"indirect_low": history(light, frames)}, {"indirect_now": 1.0})
    np.testing.assert_array_equal(found, 1.0)


def test_negative_light_does_not_darken_that_of_texels_beside_it() -> None:
    found = drawn("indirect_low", {"indirect_low": history(split(-100.0, 1.0))},
                  {"indirect_now": 1.0, "motion": moved(STEP / 2)})
    np.testing.assert_allclose(found[:, MIDDLE, :3], 0.5 + 0.5 / (FRAMES + 1), rtol=1e-3)


def test_light_of_the_grid_that_went_out_is_held_down() -> None:
    """To four times what is now."""
    found = drawn("indirect_low", {"indirect_low": history(100.0)}, {"indirect_now": 1.0})
    np.testing.assert_allclose(found[..., :3], 4 - 3 / (FRAMES + 1), rtol=1e-6)


def test_light_of_the_grid_does_not_grow_without_end() -> None:
    """Or it would never follow a change."""
    found = drawn("indirect_low", {"indirect_low": history(1.0, 1000.0)}, {"indirect_now": 1.0})
    assert found[..., 3].max() <= MAX_HISTORY[MotionKind.NONE]


def test_light_of_the_grid_is_not_kept_over_a_cut() -> None:
    found = drawn("indirect_low", {"indirect_low": history(2.0)}, {"indirect_now": 1.0}, cut=True)
    np.testing.assert_array_equal(found, 1.0)


@pytest.mark.parametrize(("normal", "depth"), [(TOWARDS, AWAY / 2), (TOWARDS, 2 * AWAY), (ASIDE, AWAY), (TOWARDS, 0.0)],
                         ids=["nearer", "farther", "other normal", "sky"])
def test_light_of_another_surface_is_not_kept(normal: ArrayLike, depth: float) -> None:
    found = drawn("indirect_low", {"indirect_low": history(2.0), "lowres_gbuffer": surfaces(normal, depth)},
                  {"indirect_now": 1.0})
    np.testing.assert_array_equal(found, 1.0)


def test_what_has_no_depth_is_another_surface_even_than_one_seen_edge_on() -> None:
    """Whose depth may change by more than itself from one pixel to the next."""
    seen = (STEP * (MIDDLE + 0.5) + 0.5) / WIDTH * 2 - 1  # by the grid's middle column, from left to right -1 to 1
    edge_on = (1.0, 0.0, round(seen * WIDTH / HEIGHT, 4))
    found = drawn("indirect_low", {"indirect_low": history(2.0), "lowres_gbuffer": surfaces(edge_on, -5 * AWAY)},
                  {"indirect_now": 1.0, "lowres_gbuffer": surfaces(edge_on, AWAY)})
    np.testing.assert_array_equal(found, 1.0)


def test_what_was_behind_the_camera_has_no_light_of_earlier_frames() -> None:
    """Its motion is unknown, and says so by a depth of 0."""
    found = drawn("indirect_low", {"indirect_low": history(2.0)}, {"indirect_now": 1.0, "motion": moved(0.0, 0.0)})
    np.testing.assert_array_equal(found, 1.0)


def test_a_sliver_of_a_surface_stands_for_none_of_its_light() -> None:
    """4 % of the texels around show it: too little for light that counts as that of all of them."""
    found = drawn("indirect_low", {"indirect_low": history(2.0), "lowres_gbuffer": surfaces(
        TOWARDS, split(AWAY, AWAY / 2))}, {"indirect_now": 1.0, "motion": moved(0.04 * STEP)})
    np.testing.assert_array_equal(found[:, MIDDLE], 1.0)


def test_pixels_that_the_grid_misses_keep_their_light() -> None:
    """Otherwise the tests below would prove nothing."""
    light = drawn("indirect", {**MISSED, "indirect": with_light(1.0)}, {**MISSED, "indirect_filled": 9.0})
    np.testing.assert_allclose(light[..., :3], 9 - 8 * KEPT, rtol=2e-3)


@pytest.mark.parametrize(("value", "expected"), [(np.nan, 9.0), (np.inf, 9.0), (-np.inf, 9.0),
                                                 (-100.0, 9.0 - 9.0 * KEPT)])
def test_broken_light_of_pixels_is_dropped(value: float, expected: float) -> None:
    light = drawn("indirect", {**MISSED, "indirect": with_light(value)}, {**MISSED, "indirect_filled": 9.0})
    np.testing.assert_allclose(light[..., :3], expected, rtol=2e-3)


def test_light_of_pixels_is_not_kept_over_a_cut() -> None:
    light = drawn("indirect", {**MISSED, "indirect": with_light(1.0)}, {**MISSED, "indirect_filled": 9.0}, cut=True)
    np.testing.assert_allclose(light[..., :3], 9.0, rtol=1e-3)


@pytest.mark.parametrize("depth", [0.0, np.nan], ids=["sky", "no number"])
def test_light_that_was_filled_in_counts_where_the_grid_shows_no_surface(depth: float) -> None:
    light = drawn("indirect", {"lowres_gbuffer": surfaces(TOWARDS, depth), "indirect_filled": 5.0})
    np.testing.assert_allclose(light[..., :3], 5.0, rtol=1e-3)


def test_the_sky_has_no_light() -> None:
    """Neither where it is alone nor between thin things that the grid misses."""
    columns = np.arange(WIDTH)
    sky = (columns % 2 == 0) | (columns >= WIDTH // 2)
    light = drawn("indirect", {"depth": np.where(sky, 0.0, AWAY)[:, None], "lowres_gbuffer": 0.0,
                               "indirect_filled": 5.0})
    np.testing.assert_allclose(light[..., :3].max(axis=(0, 2)), np.where(sky, 0.0, 5.0), rtol=1e-3)


@pytest.mark.parametrize("value", NO_NUMBERS)
@pytest.mark.parametrize("surface", [{}, MISSED], ids=["seen", "missed"])
def test_light_of_the_grid_that_is_no_number_reaches_no_pixel(surface: Mapping[str, Value], value: float) -> None:
    filled = history(1.0)
    filled[5, 7] = value
    light = drawn("indirect", {**surface, "indirect_filled": filled})
    assert np.isfinite(light).all() and light.min() >= 0 and light.max() <= HALF_MAX
    assert (light[:, WIDTH // 2 + STEP:, :3] == 1).all()


def test_a_pixel_with_a_broken_normal_has_the_light_around_it() -> None:
    light = drawn("indirect", {"normal": broken(np.nan), "lowres_gbuffer": surfaces(TOWARDS, AWAY),
                               "indirect_filled": 5.0})
    np.testing.assert_allclose(light[..., :3], 5.0, rtol=1e-3)


def broken(value: ArrayLike) -> Callable[[Image], Image]:
    """One pixel in each quad, its upper right one, replaced."""
    def replaced(image: Image) -> Image:
        image = image.copy()
        image[::2, 1::2, :3] = value
        return image

    return replaced


def test_a_pixel_of_another_surface_in_a_quad_has_no_part_in_the_others_light(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two steps draw what one does, also where pixels of a quad differ but for those beside each."""
    noise = np.random.default_rng(2).random((*GRID, 1), np.float32)
    replaced: Mapping[str, Value] = {"normal": broken(ASIDE), "lowres_gbuffer": surfaces(TOWARDS, AWAY),
                                     "indirect_filled": noise}
    found = drawn("indirect", replaced)
    monkeypatch.setattr(upsample, "quads_share_taps", lambda grid, frame: False)
    np.testing.assert_allclose(found, drawn("indirect", replaced), atol=2e-3)


def tiles(light: float) -> Value:
    """Light of its own in one tile of four, at its lower left pixel."""
    def image(missed: Image) -> Image:
        rows, columns = np.indices(missed.shape[:2])
        own = (rows % 2 == 0) & (columns % 2 == 0)
        return np.where(own[..., None], np.array((light, light, light, 1.0)), 0.0)

    return image


def missed(tile_light: Value, filled: float) -> Mapping[str, Value]:
    """The wall, missed by the grid, with light of its own in tiles."""
    return {**MISSED, "missed_light": tile_light, "missed_surface": np.array((*TOWARDS, AWAY)),
            "indirect_filled": filled}


def test_light_of_missed_pixels_reaches_all_around_and_nothing_is_darker_far_from_it() -> None:
    """Tiles without light of their own don't count, and none counts less than nothing."""
    light = drawn("indirect", missed(tiles(5.0), 5.0), model="final-gather")
    np.testing.assert_allclose(light[..., :3], 5.0, rtol=1e-3)


def test_light_of_pixels_stays_between_what_it_was_and_what_it_is() -> None:
    """However many pixels around have light of their own."""
    light = drawn("indirect", {**missed(9.0, 9.0), "indirect": with_light(1.0)},
                  missed(np.array((9.0, 9.0, 9.0, 1.0)), 9.0), model="final-gather")
    assert light[..., :3].min() >= 1 and light[..., :3].max() <= 9.01


def test_light_of_pixels_fades_also_where_no_pixel_around_has_light() -> None:
    frames = 8
    one: Mapping[str, Value] = missed(0.0, 9.0)
    light = drawn("indirect", {**one, "indirect": with_light(1.0)}, *[one] * frames, model="final-gather")
    assert light[..., :3].min() > 1.0 + 8.0 * (1 - 0.992**frames)
