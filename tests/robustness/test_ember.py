"""World surfels where there is little to lie on, nothing to shine, or no good place to look from; ``ember``'s light.

Rows "huge, tiny or far-away scenes", "no light at all" and "degenerate triangles" of the table of hazards.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from app.network.selection import find_model
from app.renderer import Renderer
from app.scene import Camera, PointLight, Scene
from app.settings import Settings
from tests.gl.scenes import Part, box, draw, make_scene, moved, slide
from tests.robustness.scenes import CAMERA, HARD_LAMP, LAMP, SIZE, corner, lit_corner

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

EMBER = find_model("ember")
OUTPUTS = ("final", "direct", "indirect", "depth")
ROOM = box((-1.0, 0.0, -1.0), (2.0, 2.0, 2.0))
LEFT, RIGHT = (-0.6, 0.0, 0.3), (0.6, 0.0, 0.3)
INSIDE = Camera((0.0, 1.0, 0.9), (0.0, 0.8, -1.0), fov_y_deg=70.0)


def shown(scene: Scene, camera: Camera | None = None) -> dict[str, np.ndarray]:
    return draw(scene, SIZE, OUTPUTS, camera, EMBER)


def tensor(scene: Scene, camera: Camera) -> np.ndarray:
    """What the network is given of the surfels, by channel."""
    with Renderer(scene, Settings(SIZE, ("indirect",), taa=False, provider="cpu"), EMBER) as renderer:
        renderer.render(camera)
        return renderer.resource("tensor_surfels")


def test_no_triangle_at_all() -> None:
    """No surfel, and a black sky."""
    scene = make_scene([], [LAMP], CAMERA)
    assert not any(image.any() for image in shown(scene).values())
    assert not tensor(scene, CAMERA)[13].any()


def test_no_triangle_to_gather_light_from() -> None:
    scene = make_scene([], [LAMP], CAMERA)
    assert not draw(scene, SIZE, ("final",), None, find_model("final-gather"))["final"].any()


def test_one_triangle_lights_nothing_but_is_lit() -> None:
    """Its surfels lie in its plane; it sees only itself, so nothing bounces."""
    triangle = Part(np.array([[[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 1.0, 0.0]]]))
    camera = Camera((0.0, 0.5, 2.0), (0.0, 0.5, 0.0))
    scene = make_scene([triangle], [PointLight((0.2, 0.6, 1.0), (1.0, 1.0, 1.0))], camera)
    images, surfels = shown(scene), tensor(scene, camera)
    assert images["direct"].max() > 0.05
    assert not images["indirect"].any()
    used = surfels[13] > 0
    assert used.sum() > 50
    np.testing.assert_allclose(surfels[2, used], -2.0 * 40.0, rtol=1e-4)  # 40 units to the longest edge, which is 1
    off = np.linalg.norm(surfels[:2, used] / 40 - [[0.2], [0.1]], axis=0)  # the light is 1 before it
    np.testing.assert_allclose(surfels[6, used], 1 / np.pi / (1 + off**2) ** 1.5, rtol=0.02)


def test_a_camera_that_sees_nothing_finds_no_surfels() -> None:
    scene = lit_corner()
    away = Camera((0.0, 50.0, 0.0), (0.0, 100.0, 0.1))
    assert not any(image.any() for image in shown(scene, away).values())


def test_without_light_the_picture_is_exactly_black() -> None:
    assert not any(shown(make_scene(corner(), (), CAMERA))[name].any() for name in ("final", "direct", "indirect"))


def test_a_light_inside_an_object_lights_nothing_outside() -> None:
    """A block that floats; where one stands on the floor, a place in the seam between both may be lit."""
    block = box((-0.3, 0.2, -0.2), (0.5, 0.6, 0.4))
    images = shown(make_scene([*corner()[:2], block], [PointLight((-0.05, 0.5, 0.0), (1.0, 1.0, 1.0))], CAMERA))
    assert (images["depth"] > 0).mean() > 0.5
    assert not images["direct"].any() and not images["indirect"].any()


def test_a_camera_that_comes_out_of_a_wall_has_the_room_lit() -> None:
    """Surfels inside the wall, where it is dark, are given up for those of a camera that was never there.

    In corners, shadow maps let a thousandth of the light in.
    """
    slab = box((-0.9, 0.0, -0.95), (1.8, 1.0, 0.1))
    scene = make_scene([ROOM, slab], [HARD_LAMP], INSIDE)
    with Renderer(scene, Settings(SIZE, OUTPUTS, taa=False, provider="cpu"), EMBER) as renderer:
        within = renderer.render(Camera((0.0, 0.5, -0.9), (0.0, 0.5, -3.0)))
        renderer.cut()
        found = renderer.render(INSIDE)["indirect"]
    assert np.median(within["depth"]) == pytest.approx(0.05, rel=1e-3)
    assert within["indirect"].max() < 1e-3 * found.max()
    np.testing.assert_array_equal(found, shown(scene)["indirect"])
    assert found.min() > 0.01


@pytest.mark.parametrize(("offset", "scale"), [((0, 0, 0), 1e-3), ((0, 0, 0), 1e3), ((1e6, -1e6, 1e6), 1.0)])
def test_huge_tiny_and_far_away_scenes_make_the_same_light(offset: tuple[float, float, float], scale: float) -> None:
    """Surfels may lie elsewhere, by rounding: 99 % of the light within a hundredth, the mean within 3 in 1000."""
    here, there = (shown(scene)["indirect"] for scene in (lit_corner(), moved(lit_corner(), offset, scale)))
    assert here.mean() > 1e-3
    assert there.mean() == pytest.approx(here.mean(), rel=3e-3)
    assert np.mean(np.abs(there - here) > 0.01 * here.max()) < 0.01


def test_an_object_on_its_way_disturbs_only_what_it_nears() -> None:
    """Indirect light stays a number, that far off stays, and back at its place the block makes the picture it made."""
    block = box((-0.15, 0.1, -0.15), (0.3, 0.3, 0.3), motion=slide([0, 1, 2], [LEFT, RIGHT, LEFT]))
    scene = make_scene([ROOM, block], [HARD_LAMP], INSIDE)
    with Renderer(scene, Settings(SIZE, OUTPUTS, taa=False, provider="cpu"), EMBER) as renderer:
        frames = [renderer.render(INSIDE, time)["indirect"] for time in (0.0, 0.3, 0.6, 1.0, 2.0)]
    assert all(np.isfinite(f).all() and f.max() < 2 * frames[0].max() for f in frames)
    assert np.abs(frames[3] - frames[0]).max() > 0.1 * frames[0].max()
    np.testing.assert_array_equal(frames[-1], frames[0])
    above = slice(0, SIZE[1] // 4)  # the ceiling and the wall below it, far from the block
    for before, now in itertools.pairwise(frames):
        assert np.abs(now - before)[above].max() < 0.05 * before[above].max()
