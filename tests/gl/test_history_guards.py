"""What temporal anti-aliasing and low-resolution history must not keep: each test fails without one guard.

``tests/robustness/guards.toml`` says which.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from app.network.selection import SSGI, Model
from app.renderer import Renderer
from app.scene import Camera, Material, PointLight, Scene, Texture
from app.settings import Settings
from tests.gl.scenes import box, make_scene, quad, slide
from tests.override import override

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

Image = NDArray[np.float32]
SIZE = (96, 72)
FRAME = 1 / 30
CAMERA = Camera((0.0, 0.0, 2.0), (0.0, 0.0, 0.0))
WALL = make_scene([quad((-4, -4, 0), (8, 0, 0), (0, 8, 0), Material(albedo=(0.5,) * 3))],
                  [PointLight((0.5, 1.0, 2.0), (5.0,) * 3)], CAMERA)
SETTLED = 24  # frames of a still


def renderer(scene: Scene = WALL, model: Model | None = None, outputs: tuple[str, ...] = ("final", "lit")) -> Renderer:
    return Renderer(scene, Settings(size=SIZE, outputs=outputs, provider="cpu"), model)


def panning() -> Iterator[Camera]:
    """By part of a pixel from frame to frame."""
    for step in range(1000):
        aside = np.array([0.007 * step, 0.003 * step, 0.0])
        yield replace(CAMERA, eye=tuple(CAMERA.eye + aside), target=tuple(CAMERA.target + aside))


def lit_by(r: Renderer, light: float | Callable[[Image], Image], frames: int, cameras: Iterator[Camera]) -> Image:
    """The last of some frames whose lit picture is ``light``."""
    override(r, "lit", light)
    for _ in range(frames):
        final = r.render(next(cameras))["final"]
    return np.asarray(final, np.float32)


def still() -> Iterator[Camera]:
    while True:
        yield CAMERA


def one_texel(value: float) -> Callable[[Image], Image]:
    """A picture of 1 with one other texel."""
    def light(image: Image) -> Image:
        image = np.ones_like(image)
        image[30, 40, :3] = value
        return image

    return light


def test_light_that_goes_out_is_gone_in_the_next_frame_of_a_pan() -> None:
    with renderer() as r:
        cameras = panning()
        lit_by(r, 1.0, 12, cameras)
        np.testing.assert_allclose(lit_by(r, 0.1, 1, cameras), 0.1, rtol=1e-3)


def test_light_that_goes_out_in_a_still_fades_within_four_frames() -> None:
    with renderer() as r:
        lit_by(r, 1.0, SETTLED, still())
        assert lit_by(r, 0.1, 4, still()).max() < 0.2


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_light_fades_also_where_its_deviation_is_no_number(value: float) -> None:
    with renderer() as r:
        lit_by(r, 1.0, SETTLED, still())
        override(r, "taa_deviation", value)
        r.advance(CAMERA)
        override(r, "taa_deviation", None)
        assert lit_by(r, 0.1, 4, still()).max() < 0.2


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_still_is_not_sharpened_where_the_count_of_resamplings_is_no_number(value: float) -> None:
    pixels = np.random.default_rng(2).integers(0, 256, (8, 8, 4), np.uint8)
    pattern = Material(albedo_map=Texture(pixels))
    scene = make_scene([quad((-4, -4, 0), (8, 0, 0), (0, 8, 0), pattern)], WALL.lights, CAMERA)
    with renderer(scene, outputs=("final", "lit")) as r:
        r.advance(CAMERA)
        override(r, "resampled", value)
        r.advance(CAMERA)
        override(r, "resampled", None)
        final = r.render(CAMERA)["final"]
        np.testing.assert_array_equal(final, r.resource("taa")[..., :3])


def test_what_settled_around_a_flash_goes_with_it() -> None:
    """In a quad one texel's history is far too bright, and that of the others is what such samples lead to expect."""
    def flashed(image: Image) -> Image:
        image = image.copy()
        image[..., :3] = 3.0
        image[1::2, 1::2, :3] = 50.0
        return image

    with renderer() as r:
        lit_by(r, 1.0, SETTLED, still())
        override(r, "taa", flashed)
        override(r, "taa_deviation", 0.6)
        r.advance(CAMERA)
        override(r, "taa", None)
        override(r, "taa_deviation", None)
        assert lit_by(r, 1.0, 2, still()).max() < 1.1


def test_one_bright_sample_in_a_still_is_no_speck() -> None:
    with renderer() as r:
        lit_by(r, 1.0, SETTLED, still())
        assert lit_by(r, one_texel(3e4), 1, still()).max() < 20


def test_what_was_hidden_shows_this_frame_alone() -> None:
    """A box slides by before a wall of noise, whose variance would let pass all that was there before."""
    noise = np.random.default_rng(0).uniform(0, 2, (*SIZE[::-1], 1)).astype(np.float32)
    mover = box((-0.3, -0.4, 0.2), (0.6, 0.8, 0.3), Material(), slide([0, 2], [(-0.8, 0, 0), (1.6, 0, 0)]))
    scene = replace(make_scene([quad((-4, -4, 0), (8, 0, 0), (0, 8, 0)), mover], WALL.lights, CAMERA))
    with renderer(scene, outputs=("final", "lit", "instance")) as r:
        override(r, "lit", lambda image: np.broadcast_to(noise, image.shape).astype(np.float32))
        before = r.render(CAMERA, 0.0)["instance"][..., 0]
        uncovered = 0
        for frame in range(1, 12):
            images = r.render(CAMERA, frame * 3 * FRAME)
            now = images["instance"][..., 0]
            new = binary_erosion((before == 2) & (now == 1), np.ones((3, 3)), iterations=2)
            np.testing.assert_array_equal(images["final"][new], images["lit"][new])
            uncovered, before = uncovered + int(new.sum()), now
    assert uncovered > 300


def test_what_comes_into_the_picture_shows_this_frame_alone() -> None:
    """History ends at the picture's edge: a bright wall that pans in has none of the last column."""
    noise = np.random.default_rng(1).uniform(0, 2, (*SIZE[::-1], 1)).astype(np.float32)
    with renderer() as r:
        override(r, "lit", lambda image: np.broadcast_to(noise, image.shape).astype(np.float32))
        for step in range(6):
            eye = (0.2 * step, 0.0, 2.0)
            images = r.render(replace(CAMERA, eye=eye, target=(eye[0], 0.0, 0.0)))
            if step:
                np.testing.assert_array_equal(images["final"][4:-4, -5:], images["lit"][4:-4, -5:])


def test_no_indirect_light_is_kept_over_a_cut() -> None:
    with renderer(model=SSGI, outputs=("final", "indirect")) as r:
        override(r, "indirect_now", 1.0)
        for _ in range(5):
            r.advance(CAMERA)
        r.cut()
        override(r, "indirect_now", 0.5)
        r.advance(CAMERA)
        np.testing.assert_array_equal(r.resource("indirect_low")[..., :3], 0.5)


def test_indirect_light_that_goes_out_is_held_down() -> None:
    with renderer(model=SSGI, outputs=("final", "indirect")) as r:
        override(r, "indirect_now", 10.0)
        for _ in range(SETTLED):
            r.advance(CAMERA)
        override(r, "indirect_now", 0.01)
        r.advance(CAMERA)
        assert r.resource("indirect_low")[..., :3].max() <= 0.05


@pytest.mark.parametrize("texel", [(3.0, 3.0, 3.0, 0.0), (np.nan, np.nan, np.nan, 8.0)], ids=["no frames", "nan"])
def test_broken_history_of_indirect_light_counts_for_nothing(texel: tuple[float, ...]) -> None:
    def broken(image: Image) -> Image:
        image = image.copy()
        image[np.indices(image.shape[:2]).sum(axis=0) % 2 == 1] = texel
        return image

    cameras = panning()
    with renderer(model=SSGI, outputs=("final", "indirect")) as r:
        override(r, "indirect_now", 1.0)
        for _ in range(3):
            r.advance(next(cameras))
        override(r, "indirect_low", broken)
        r.advance(next(cameras))
        override(r, "indirect_low", None)
        r.advance(next(cameras))
        np.testing.assert_allclose(r.resource("indirect_low")[..., :3], 1.0, rtol=1e-6)


def test_indirect_light_that_is_no_number_stays_out_of_the_history() -> None:
    def broken(image: Image) -> Image:
        image = image.copy()
        image[20, 20] = np.nan
        return image

    with renderer(model=SSGI, outputs=("final", "indirect")) as r:
        override(r, "indirect_now", broken)
        r.advance(CAMERA)
        assert np.isfinite(r.resource("indirect_low")).all()
