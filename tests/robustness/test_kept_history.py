"""Which history temporal anti-aliasing keeps: all of a texel's input is given, and one frame later its history is read.

Each test is about one or more guards of ``taa.frag``, see ``guards.toml``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from app.network.channels import HALF_MAX
from app.renderer import Renderer
from app.scene import Camera, Environment, Material, Scene, Texture
from app.settings import Settings
from tests.gl.scenes import make_scene, quad
from tests.override import Value, draw_replaced

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

Image = NDArray[np.float32]
SIZE = WIDTH, HEIGHT = 13, 11  # odd both ways
TEXTURE = Texture(np.ones((1, 1, 4), np.float32))  # so that how often a texel was resampled is known, too
WALL = make_scene([quad((-4, -4, 0), (8, 0, 0), (0, 8, 0), Material(albedo_map=TEXTURE))],
                  camera=Camera((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), fov_y_deg=45.0))
AWAY = 2.0              # distance of the wall
INVERSE_DEPTH = 0.4     # of it, as shaders store it
FRAMES = 16.0           # that have settled
ROW, COLUMN = 4, 6      # of a texel amid the others, in the lower left of its quad
MOVED = (1.0, 0.0)      # pixels
NO_NUMBERS = [np.nan, np.inf, -np.inf, -100.0]


def after(lit: ArrayLike, history: ArrayLike, frames: float = FRAMES, moved: tuple[float, float] | None = None,
          before: Mapping[str, Value] | None = None, now: Mapping[str, Value] | None = None,
          resource: str = "taa") -> Image:
    """What temporal anti-aliasing writes in a frame with light ``lit`` that finds a history of so many frames.

    Parameters
    ----------
    moved : tuple of float, optional
        Pixels by which everything moves to the right and down, also the camera a little. Otherwise nothing moves.
    before, now : mapping, optional
        Other resources in the frame before, and in this one.
    """
    past, light = np.empty((2, HEIGHT, WIDTH, 4), np.float32)
    past[..., :3], past[..., 3], light[..., :3], light[..., 3] = history, frames, lit, 1.0
    camera = WALL.cameras["main"].at(0.0)
    motion = {} if moved is None else {"motion": np.array((*moved, 1.0, INVERSE_DEPTH))}
    cameras = [camera, camera if moved is None else replace(camera, eye=(1e-3, 0.0, 2.0), target=(1e-3, 0.0, 0.0))]
    with Renderer(WALL, Settings(SIZE, ("final",))) as renderer:
        draw_replaced(renderer, cameras, {"depth": AWAY, "taa": past, "taa_deviation": 0.0, "resampled": 0.0,
                                          **(before or {})}, {"lit": light, **motion, **(now or {})})
        return renderer.resource(resource)


def everywhere(value: ArrayLike, at_texel: ArrayLike) -> Image:
    """The same colour everywhere but in one texel."""
    image = np.empty((HEIGHT, WIDTH, 3), np.float32)
    image[:], image[ROW, COLUMN] = value, at_texel
    return image


def contrasts(low: float, high: float) -> Image:
    """Single texels of one and the other brightness."""
    rows, columns = np.indices((HEIGHT, WIDTH))
    return np.where((rows + columns) % 2, high, low)[..., None].repeat(3, axis=2).astype(np.float32)


def assert_new(taa: Image, lit: ArrayLike) -> None:
    """There is none of the history in it."""
    np.testing.assert_array_equal(taa[..., 3], 1.0)
    np.testing.assert_array_equal(taa[..., :3], np.broadcast_to(lit, (HEIGHT, WIDTH, 3)))


def test_history_is_kept_of_what_moves_and_of_what_does_not() -> None:
    """Otherwise the tests below would prove nothing."""
    still, moving = after(1.0, 1.0), after(1.0, 1.0, 4.0, MOVED)
    np.testing.assert_array_equal(still[..., 3], FRAMES + 1)
    np.testing.assert_array_equal(moving[:, 1:, 3], 5.0)


@pytest.mark.parametrize("depth", [AWAY / 2, 2 * AWAY, [[[0.0], [2 * AWAY]] * 6 + [[0.0]]]],
                         ids=["behind something", "before something", "before an edge"])
def test_what_was_hidden_or_not_there_has_no_history(depth: ArrayLike) -> None:
    """Also at the border, and where the history is much brighter than the picture."""
    lit = contrasts(1e-3, 6e4).astype(np.float16)
    assert_new(after(lit, 6e4, moved=MOVED, before={"depth": np.asarray(depth)}), lit)
    assert_new(after(lit, 6e4, moved=(-1.0, 0.0), before={"depth": np.asarray(depth)}), lit)


@pytest.mark.parametrize(("moved", "entering"), [((2, 0), np.s_[:, :2]), ((-2, 0), np.s_[:, -2:]),
                                                 ((0, 2), np.s_[:2]), ((0, -2), np.s_[-2:])],
                         ids=["left", "right", "top", "bottom"])
def test_what_comes_into_the_picture_has_no_history(moved: tuple[float, float], entering: tuple[slice, ...]) -> None:
    frames = after(1.0, 1.0, 4.0, moved)[..., 3]
    np.testing.assert_array_equal(frames[entering], 1.0)
    assert frames.mean() > 3


@pytest.mark.parametrize("motion", [(0.0, 0.0, 0.5, INVERSE_DEPTH), (3.0, 0.0, 1.0, INVERSE_DEPTH)],
                         ids=["in depth", "sideways"])
def test_motion_contradicts_history_also_in_a_still_picture(motion: tuple[float, ...]) -> None:
    assert_new(after(1.0, 2.0, before={"depth": AWAY / 4}, now={"motion": np.array(motion)}), 1.0)


@pytest.mark.parametrize("channel", [0, 1, 2])
@pytest.mark.parametrize("value", NO_NUMBERS[:3])
def test_motion_that_is_no_number_leads_to_no_history(channel: int, value: float) -> None:
    motion = np.array((0.0, 0.0, 1.0, INVERSE_DEPTH))
    motion[channel] = value
    assert_new(after(1.0, 2.0, now={"motion": motion}), 1.0)


def test_the_empty_background_keeps_its_history() -> None:
    """It has no depth of which a ratio could be told."""
    nothing = after(0.0, 0.0, before={"depth": 0.0}, now={"motion": 0.0})
    np.testing.assert_array_equal(nothing[..., 3], FRAMES + 1)


@pytest.mark.parametrize(("degrees", "kept"), [(5.0, 0.5), (90.0, 0.0), (180.0, 0.0)])
def test_the_sky_moves_as_the_camera_turns(degrees: float, kept: float) -> None:
    """What was beside or behind the camera has no history."""
    def towards(angle: float) -> Camera:
        return Camera((0.0, 0.0, 0.0), (float(np.sin(angle)), 0.0, float(-np.cos(angle))), fov_y_deg=45.0)

    sky = Environment(np.ones((4, 8, 3), np.float32))
    below: Scene = replace(make_scene([quad((-1, -50, 0), (2, 0, 0), (0, 0, -2))]), environment=sky)
    with Renderer(below, Settings(SIZE, ("final",))) as renderer:
        draw_replaced(renderer, [towards(0.0), towards(np.radians(degrees))], {}, {})
        share = float((renderer.resource("taa")[..., 3] > 1).mean())
    assert share > kept if kept else share == 0


@pytest.mark.parametrize("frames", [0.0, 0.5, -100.0, np.nan, np.inf])
def test_history_of_no_number_of_frames_is_none(frames: float) -> None:
    assert_new(after(1.0, 2.0, frames), 1.0)


@pytest.mark.parametrize("moved", [None, MOVED], ids=["still", "moving"])
@pytest.mark.parametrize("value", NO_NUMBERS)
def test_light_that_is_no_number_stays_out_of_the_history(value: float, moved: tuple[float, float] | None) -> None:
    taa = after(everywhere(1.0, value), 1.0, moved=moved)
    assert np.isfinite(taa).all() and taa.min() >= 0 and taa.max() <= HALF_MAX


@pytest.mark.parametrize(("frames", "moved"), [(1000.0, None), (1000.0, MOVED)])
def test_history_does_not_grow_without_end(frames: float, moved: tuple[float, float] | None) -> None:
    """Or what changes unnoticed would never be seen."""
    assert after(1.0, 1.0, frames, moved)[..., 3].max() <= (256 if moved is None else 8)


def test_history_that_contradicts_the_picture_is_clipped_up_to_its_border() -> None:
    """Light went down by a third, which nothing announced."""
    np.testing.assert_allclose(after(1.0, 1.5)[..., :3], 1.0, rtol=1e-6)


@pytest.mark.parametrize(("frames", "moved", "expected"), [(3.0, None, 4.0), (FRAMES, None, 5.0), (8.0, MOVED, 3.0)],
                         ids=["first frames", "settled", "moving"])
def test_clipped_history_counts_less_unless_it_is_short(frames: float, moved: tuple[float, float] | None,
                                                        expected: float) -> None:
    """So that the picture soon follows, and the first frames have no more noise than others."""
    taa = after(1.0, 1.5, frames, moved)
    np.testing.assert_allclose(taa[:, 1:, 3], expected, rtol=1e-6)


def test_the_undershoot_of_the_filter_costs_no_history() -> None:
    """Beside a bright line, where nothing changes but that the line moves."""
    line = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    line[:, COLUMN] = 6e4
    frames = after(0.0, line, 4.0, (0.5, 0.0))[..., 3]
    np.testing.assert_array_equal(frames[:, 1:COLUMN], 5.0)
    np.testing.assert_array_equal(frames[:, COLUMN + 2:], 5.0)


def test_clipped_colours_are_not_negative() -> None:
    """Not even by rounding, of bright saturated colours beside dark ones."""
    rng = np.random.default_rng(1)
    lit, history = (rng.choice([0.0, 0.1, 7.0, 6e4], (HEIGHT, WIDTH, 3)).astype(np.float32) for _ in range(2))
    for moved in (None, MOVED):
        assert after(lit, history, 8.0, moved)[..., :3].min() >= 0


@pytest.mark.parametrize("resource", ["taa", "taa_deviation"])
@pytest.mark.parametrize("history", [1.0, 1.5])
@pytest.mark.parametrize("value", NO_NUMBERS)
def test_a_deviation_that_is_no_number_counts_as_none(value: float, history: float, resource: str) -> None:
    found, expected = (after(1.0, history, before={"taa_deviation": deviation}, resource=resource)
                       for deviation in (value, 0.0))
    np.testing.assert_array_equal(found, expected)


def test_what_was_clipped_says_nothing_about_deviations() -> None:
    """Or a flash would leave room for another one."""
    deviation = after(1.0, 100.0, before={"taa_deviation": 0.5}, resource="taa_deviation")
    np.testing.assert_allclose(deviation, 0.0, atol=1e-6)


@pytest.mark.parametrize(("value", "most"), [(np.nan, 0.0), (np.inf, 0.0), (-100.0, 0.0), (1e4, 8.0)])
def test_a_broken_number_of_resamplings_sharpens_nothing_for_long(value: float, most: float) -> None:
    resampled = after(1.0, 1.0, before={"resampled": value}, resource="resampled")
    assert resampled.min() >= 0 and resampled.max() <= most


def test_what_has_flashed_is_forgotten_also_beside_it() -> None:
    """Where the history has settled around the flash, as if that light were expected."""
    taa = after(1.0, everywhere(1.5, 100.0), before={"taa_deviation": 0.2})
    for row, column in ((ROW, COLUMN), (ROW - 1, COLUMN + 1), (ROW + 1, COLUMN - 1)):
        np.testing.assert_allclose(taa[row, column, :3], 1.0, rtol=1e-6)


@pytest.mark.parametrize(("frames", "around", "most"), [(2.0, 1.0, 48.0), (FRAMES, 1.0, 48.0), (FRAMES, 1e4, 4.0)],
                         ids=["first frames", "speck", "area"])
def test_one_frame_of_bright_light_is_held_down(frames: float, around: float, most: float) -> None:
    """To so many times the light before, so that it doesn't linger."""
    taa = after(everywhere(around, 1e4), 1.0, frames)
    assert taa[ROW, COLUMN, :3].max() <= (1 + (most - 1) / (frames + 1)) * (1 + 1e-5)


@pytest.mark.parametrize("around", [0.0, 1.0])
@pytest.mark.parametrize("frames", [2.0, FRAMES])
def test_light_comes_on_out_of_black(frames: float, around: float) -> None:
    """Of which no multiple is light."""
    assert after(everywhere(around, 1.0), 0.0, frames)[ROW, COLUMN, :3].min() > 0.05


def test_light_as_bright_as_around_is_not_held_down() -> None:
    """Where an edge has left a dark texel."""
    taa = after(1.0, everywhere(1.0, 1e-3), 2.0)
    np.testing.assert_allclose(taa[ROW, COLUMN, :3], 1.0, rtol=1e-6)


def test_few_samples_do_not_tell_what_to_expect() -> None:
    np.testing.assert_allclose(after(1.0, 1.8, 3.0, before={"taa_deviation": 1.0})[..., :3], 1.0, rtol=1e-6)
    np.testing.assert_allclose(after(10.0, 1.0, 2.0)[..., :3], 10.0, rtol=1e-6)


def test_a_thin_bright_thing_takes_the_colour_of_what_was_there() -> None:
    """Blue light has gone; a white glint in the same frame doesn't save it."""
    taa = after(everywhere(0.1, 10.0), (0.0, 0.0, 1.0))[ROW, COLUMN]
    assert taa[2] == pytest.approx(taa[0], rel=1e-3)
