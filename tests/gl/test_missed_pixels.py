"""Surfaces that the low-resolution grid misses are lit by their own light."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.frame import FrameInputs
from app.network.selection import find_model
from app.passes.missed_pixels import MAX_TILES, tile_side
from app.renderer import Renderer
from app.scene import Camera, PointLight, Scene
from app.settings import Settings
from tests.gl.scenes import GREY, Images, Part, box, make_scene

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

SIZE = (512, 384)
CAMERA = Camera((0.0, 1.2, 3.5), (0.0, 1.0, 0.0), fov_y_deg=50)
WRONG = 0.2  # relative error of a pixel's light


@pytest.fixture(scope="module")
def small(small_ember: Path) -> Path:
    pytest.importorskip("torch", reason="export needs torch")
    return small_ember


def room() -> Scene:
    """A dark red and a bright wall, and between them shelves and rods, a few pixels thick, that face both."""
    walls = box((-2.5, 0, -2), (5, 2.6, 6))
    red = box((-2.45, 0, -2), (0.05, 2.6, 6), replace(GREY, albedo=(0.6, 0.02, 0.02)))
    shelves: list[Part] = [box((-1.5, 0.3 + 0.35 * i, -0.6), (3.0, 0.025, 0.5)) for i in range(5)]
    rods = [box((-1.6 + 0.4 * i, 0.1, 0.4), (0.02, 1.8, 0.02)) for i in range(9)]
    return make_scene([walls, red, *shelves, *rods], [PointLight((2.0, 2.2, 2.5), (6.0,) * 3)], CAMERA)


def draw(model: Path, cameras: list[Camera], *, taa: bool, scale: float | None = None) -> Images:
    """The last of some frames."""
    with Renderer(room(), Settings(SIZE, ("final", "indirect", "depth"), taa=taa, provider="cpu", scale=scale),
                  model) as renderer:
        return [renderer.render(camera) for camera in cameras][-1]


def wrong_share(found: Images, expected: Images) -> float:
    """Share of the surface's pixels whose light is wrong."""
    light, truth = found["indirect"].mean(axis=-1), expected["indirect"].mean(axis=-1)
    surface = np.squeeze(expected["depth"]) > 0
    return float((np.abs(light - truth) > WRONG * truth)[surface].mean())


def swaying(frames: int) -> list[Camera]:
    offsets = 0.3 * np.sin(np.arange(frames) / 8)
    return [replace(CAMERA, eye=(x, 1.2, 3.5), target=(x, 1.0, 0.0)) for x in offsets.tolist()]


@pytest.mark.parametrize(("cameras", "taa"), [([CAMERA], False), ([CAMERA] * 12, True), (swaying(12), True)],
                         ids=["first frame", "still", "moving"])
def test_thin_things_have_the_light_that_the_network_gives_at_every_pixel(
        small: Path, cameras: list[Camera], taa: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = draw(small, cameras, taa=taa, scale=1.0)
    found = wrong_share(draw(small, cameras, taa=taa), expected)
    monkeypatch.setattr(FrameInputs, "has_surfel_indirect", False)
    without = wrong_share(draw(small, cameras, taa=taa), expected)
    assert without > 0.02  # the scene has what the grid misses
    assert found < without / 8


def test_no_pixel_is_asked_for_where_the_model_gives_no_light_of_surfels() -> None:
    with Renderer(room(), Settings((64, 48), provider="cpu"), find_model("radiosity")) as renderer:
        assert {"missed_pixels", "missed_light"} <= set(renderer.plan.culled)


def test_the_number_of_tiles_is_bounded() -> None:
    assert tile_side((1024, 768)) == tile_side((16, 16)) == 8
    for size in ((1920, 1080), (8192, 4096), (65536, 2)):
        side = tile_side(size)
        assert -(-size[0] // side) * -(-size[1] // side) <= MAX_TILES
