"""Light kept from frame to frame stays where it is on the surfaces that a camera moves along."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from app.gl.frame_state import MAX_HISTORY, MotionKind
from app.network.selection import find_model
from app.renderer import Renderer
from app.scene import Camera
from app.settings import Settings
from tests.gl.scenes import Part, floor, make_scene, quad
from tests.override import override

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

Light = Callable[[NDArray[np.float32]], NDArray[np.float64]]

SIZE = (256, 192)
PICKED = np.s_[2::4, 2::4]  # what a network sees of it
PIXEL = 4.0 / SIZE[1]  # at the post, where the picture is 4 high
WALL = quad((-30, -30, -20), (60, 0, 0), (0, 60, 0))
POST = quad((0, -4, -2), (2 * PIXEL, 0, 0), (0, 8, 0))
KEPT = 1 - 1 / MAX_HISTORY[MotionKind.CAMERA]  # of what a pixel had, in a frame in which no pick shows it


@pytest.mark.parametrize("pace", [0.05, -0.05, 0.2], ids=["forward", "backward", "fast"])
def test_light_does_not_creep_along_a_floor(pace: float) -> None:
    """On a plane seen askew, neighbours differ in depth by more than any tolerance of it could let through."""
    scene = make_scene([floor(100.0, y=-1.6)], camera=walking(0))
    with (Renderer(scene, Settings(SIZE, ("position", "depth"), taa=False)) as eye,
          Renderer(scene, Settings(SIZE, ("indirect",), provider="cpu"), find_model("gather")) as renderer):
        for frame in range(12):
            camera = walking(pace * frame)
            seen = eye.render(camera)
            light = falling_off(seen["position"][PICKED])
            override(renderer, "indirect_now", light)
            renderer.advance(camera)
        gathered = renderer.resource("indirect_low")
    depth = seen["depth"][PICKED][..., 0]
    near = (depth > 0) & (depth < 20)
    near[-2:] = False  # was below the picture when the camera moves backward
    assert gathered[near, 3].mean() > 0.8 * MAX_HISTORY[MotionKind.CAMERA]
    np.testing.assert_allclose(gathered[near, 0], light[near, 0], rtol=0.01)


def walking(way: float) -> Camera:
    return Camera((0.0, 0.0, -way), (0.0, -0.3, -way - 1.0), fov_y_deg=60)


def falling_off(position: NDArray[np.float32]) -> NDArray[np.float32]:
    """Light that falls with the distance from a place behind the camera, [H, W, 1]."""
    return 1 / (4 - position[..., 2:])


def test_jitter_does_not_cut_the_history_of_a_far_floor() -> None:
    """Where depth changes by more than its tolerance from one pixel to the next."""
    scene = make_scene([floor(400.0, y=-1.6)], camera=walking(0))
    with Renderer(scene, Settings(SIZE, ("final", "depth"), provider="cpu"), find_model("gather")) as renderer:
        for _ in range(24):
            renderer.advance(walking(0))
        depth, frames = renderer.render(walking(0))["depth"], renderer.resource("indirect_low")[..., 3]
    far = (depth[PICKED][..., 0] > 15) & (depth[PICKED][..., 0] < 40)
    assert far.sum() > 50
    assert frames[far].mean() > 20


def test_what_is_too_thin_for_the_picks_keeps_its_light() -> None:
    """A post two pixels wide is shown by one frame in two; without history it has the wall's light in the other."""
    scene = make_scene([WALL, POST])
    hidden: int | None = None  # frames since the picks showed the post
    with (Renderer(scene, Settings(SIZE, ("depth", "position"), taa=False)) as eye,
          Renderer(scene, Settings(SIZE, ("indirect",), provider="cpu"), find_model("gather")) as renderer):
        for frame in range(16):  # right and up; from 9 on the camera stands
            camera = beside(min(frame, 9), min(frame, 9) * 4)
            seen = eye.render(camera)
            post, own = seen["depth"][..., 0] < 10, 4.5 + seen["position"][..., 1]
            override(renderer, "indirect_now", np.where(post, own, 9.0)[PICKED][..., None])
            light = renderer.render(camera)["indirect"]
            if post[PICKED].any():
                hidden = 0
            elif hidden is not None:
                hidden += 1
            judged = post & (np.abs(np.arange(SIZE[1]) - 96) < 80)[:, None]  # new rows came in at the top
            expected = 9.0 if hidden is None else 9 - (9 - own[judged]) * KEPT**hidden
            np.testing.assert_allclose(light[judged, 0], expected, rtol=0.01)  # a half float rounds in each frame
    assert hidden is not None


def second_frame(things: list[Part], first: tuple[Camera, Light], second: tuple[Camera, Light],
                 cut: bool = False) -> NDArray[np.float32]:
    """Indirect light in the second of two frames at what stands from 1.5 to 10 away, where no pick shows that.

    Each frame has a camera and, from depth, what the network makes of what it sees.
    """
    scene = make_scene([WALL, *things])
    with (Renderer(scene, Settings(SIZE, ("depth",), taa=False)) as eye,
          Renderer(scene, Settings(SIZE, ("indirect",), provider="cpu"), find_model("gather")) as renderer):
        for camera, light in (first, second):
            depth = eye.render(camera)["depth"][..., 0]
            override(renderer, "indirect_now", light(depth)[PICKED][..., None])
            found = renderer.render(camera)["indirect"]
            if cut:
                renderer.cut()
    thing = (depth > 1.5) & (depth < 10)
    assert thing.any() and not thing[PICKED].any()
    return found[thing, 0]


def lit(near: float, wall: float) -> Light:
    return lambda depth: np.where(depth < 10, near, wall)



def test_what_comes_out_from_behind_something_has_none_of_its_light() -> None:
    occluder = quad((-4, -4, -1), (4 + 1.5 * PIXEL, 0, 0), (0, 8, 0))
    found = second_frame([POST, occluder], (beside(0), lambda depth: np.where(depth < 1.5, 1.0, 9.0)),
                         (beside(8), lambda depth: np.where(depth < 1.5, 1.0, 9.0)))
    np.testing.assert_allclose(found, 9.0, rtol=0.01)


def test_the_other_side_of_a_sheet_has_none_of_its_light() -> None:
    """The camera crosses the plane of a fin that reaches away from it."""
    fin = quad((0, -4, -4), (0, 0, 2), (0, 8, 0))
    found = second_frame([fin], (beside(5.76), lit(9.0, 1.0)), (beside(-5.76), lit(1.0, 1.0)))
    np.testing.assert_allclose(found, 1.0, rtol=0.01)


def test_light_is_kept_on_the_way_towards_something() -> None:
    """By 8 % of its distance, more than depth may be off."""
    post = quad((2.2 * PIXEL, -4, -2), (1.6 * PIXEL, 0, 0), (0, 8, 0))
    found = second_frame([post], (beside(-0.1), lit(1.0, 9.0)), (beside(2.2, forward=0.16), lit(1.0, 9.0)))
    np.testing.assert_allclose(found, 9 - 8 * KEPT, rtol=0.01)


@pytest.mark.parametrize(("cut", "expected"), [(False, 9 - 8 * KEPT), (True, 9.0)])
def test_nothing_is_kept_over_a_cut(cut: bool, expected: float) -> None:
    found = second_frame([POST], (beside(-2), lit(1.0, 9.0)), (beside(0), lit(1.0, 9.0)), cut)
    np.testing.assert_allclose(found, expected, rtol=0.01)


def test_nothing_is_kept_over_a_cut_of_the_same_view() -> None:
    with Renderer(make_scene([WALL, POST]), Settings(SIZE, ("indirect",), provider="cpu"), find_model("gather")) as r:
        override(r, "indirect_now", np.full((SIZE[1] // 4, SIZE[0] // 4, 1), 9.0))
        override(r, "indirect", lambda light: np.where(np.arange(4) < 3, 5.0, light))
        r.advance(beside(0))
        override(r, "indirect", None)
        r.cut()
        light = r.render(beside(0))["indirect"]
    np.testing.assert_allclose(light, 9.0, rtol=0.01)


def test_light_that_went_out_is_held_down() -> None:
    found = second_frame([POST], (beside(-2), lit(100.0, 1.0)), (beside(0), lit(1.0, 1.0)))
    np.testing.assert_allclose(found, 1 + 3 * KEPT, rtol=0.01)  # at most four times what is now


def test_light_that_was_no_number_is_not_kept() -> None:
    scene = make_scene([WALL, POST])
    with Renderer(scene, Settings(SIZE, ("indirect",), provider="cpu"), find_model("gather")) as renderer:
        override(renderer, "indirect_now", np.full((SIZE[1] // 4, SIZE[0] // 4, 1), 9.0))
        override(renderer, "indirect", lambda light: np.where(np.arange(4) < 3, np.nan, light))
        renderer.advance(beside(0))
        override(renderer, "indirect", None)
        light = renderer.render(beside(0.1))["indirect"]
    np.testing.assert_allclose(light, 9.0, rtol=0.01)


def beside(right: float, up: float = 0.0, forward: float = 0.0) -> Camera:
    """Looks at the wall from pixels, at the post, right of its left edge and above the middle."""
    x, y = (right + 0.1) * PIXEL, up * PIXEL
    return Camera((x, y, -forward), (x, y, -forward - 1), fov_y_deg=90)
