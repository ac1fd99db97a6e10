"""What temporal anti-aliasing keeps: negative lobes, variance, poison, first frames, cuts, other sizes.

Rows "NaN or Inf in history or bilateral neighbourhood", "negative lobes of the cubic filter", "variance below zero" and
"first frame, resize, cut" of the table of hazards; poison in every pass is in ``test_poison.py``.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from app.network.channels import HALF_MAX
from app.network.selection import SSGI
from app.radiance_scale import radiance_scale
from app.renderer import Renderer
from app.scene import Camera, Scene
from app.settings import Settings
from tests.override import override
from tests.robustness.scenes import CAMERA, RADIOSITY, SIZE, assert_same, lit_corner

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

Image = NDArray[np.float32]
SCENE = lit_corner()
MOST = 60000.0  # near the end of the half range
OUTPUTS = ("final", "lit")


def renderer(size: tuple[int, int] = SIZE, scene: Scene = SCENE) -> Renderer:
    return Renderer(scene, Settings(size=size, outputs=OUTPUTS, provider="cpu"), RADIOSITY)


def beside(step: int) -> Camera:
    """Moves by part of a pixel from frame to frame, so that history is interpolated."""
    return replace(CAMERA, eye=(CAMERA.eye[0] + 0.013 * step, *CAMERA.eye[1:]),
                   target=(CAMERA.target[0] + 0.013 * step, *CAMERA.target[1:]))


def checked(tile: int) -> Image:
    """Squares of 60000 beside squares of 0."""
    rows, columns = np.indices((SIZE[1], SIZE[0])) // tile
    return np.repeat(MOST * ((rows + columns) % 2)[..., None], 4, axis=2).astype(np.float32)


@pytest.mark.parametrize("tile", [1, 2, 5])
def test_60000_beside_0_gives_nothing_below_0(tile: int) -> None:
    """Row "negative lobes": the filter's undershoot is clamped, its overshoot stays within the half range."""
    assert radiance_scale(SCENE) == 1
    with renderer() as r:
        override(r, "lit", checked(tile))
        for step in range(8):
            final = r.render(beside(step))["final"]
            assert final.min() >= 0 and final.max() <= HALF_MAX
        assert final.mean() == pytest.approx(MOST / 2, rel=0.1)


@pytest.mark.parametrize("value", [1e-4, 1.0, MOST])
@pytest.mark.parametrize("moves", [False, True])
def test_a_constant_bright_picture_stays_exactly_so(value: float, moves: bool) -> None:
    """Row "variance below zero": the mean square less the square of the mean is rounding alone.

    The guards of ``taa.frag`` can't be told apart on llvmpipe, whose max(NaN, x) is x; GLSL leaves that open.
    """
    with renderer() as r:
        override(r, "lit", value)
        for step in range(12):
            final = r.render(beside(step * moves))["final"]
            np.testing.assert_allclose(final, np.float32(np.float16(value)), rtol=1e-6)


def test_a_still_constant_picture_counts_all_its_frames() -> None:
    """No deviation clips it, and more frames count than of what moves."""
    with renderer() as r:
        override(r, "lit", 1.0)
        for frames in range(1, 41):
            r.advance(CAMERA)
            assert r.resource("taa")[..., 3].max() == frames
        seen = r.resource("depth")[..., 0] > 0
        assert (r.resource("taa")[seen][..., 3] == frames).mean() > 0.8


def test_noisy_light_keeps_its_history_where_now_is_black() -> None:
    """It is compared with the mean around: of squares that are light in every other frame, half the light stays."""
    frames, turns = 8, itertools.count()

    def squares(image: Image) -> Image:
        return np.float32(2) * ((np.indices(image.shape[:2]).sum(axis=0) + next(turns)) % 2)[..., None]

    with Renderer(SCENE, Settings(size=SIZE, provider="cpu"), SSGI) as r:
        override(r, "indirect_now", squares)
        for _ in range(frames):
            r.advance(CAMERA)
        light = r.resource("indirect_low")
        kept = light[..., 3] == frames
        assert kept.mean() > 0.3
        np.testing.assert_allclose(light[kept][..., :3], 1.0, rtol=1e-3)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_one_broken_texel_of_the_history_heals_in_one_frame_and_stays_alone(value: float) -> None:
    """In the frame after, the poisoned texel is the current frame's; all farther than two texels are untouched."""
    def poisoned(image: Image) -> Image:
        image = image.copy()
        image[20, 30] = value
        return image

    def run(poison: bool) -> list[Image]:
        with renderer() as r:
            for _ in range(4):
                r.advance(CAMERA)
            override(r, "taa", poisoned if poison else None)
            r.advance(CAMERA)
            override(r, "taa", None)
            return [r.render(CAMERA)["final"] for _ in range(3)]

    rows, columns = np.indices((SIZE[1], SIZE[0]))
    far = np.maximum(abs(rows - 20), abs(columns - 30)) > 2
    for clean, dirty in zip(run(False), run(True), strict=True):
        np.testing.assert_array_equal(dirty[far], clean[far])
        assert np.isfinite(dirty).all()
        np.testing.assert_allclose(dirty[20, 30], clean[20, 30], atol=0.2 * clean.max())


def test_the_first_frame_has_no_history() -> None:
    with renderer() as r:
        first = r.render(CAMERA)
        np.testing.assert_array_equal(first["final"], first["lit"])


def test_after_a_cut_frames_are_those_of_a_new_renderer() -> None:
    with renderer() as r, renderer() as new:
        for step in range(5):
            r.advance(beside(7 * step))
        r.cut()
        for _ in range(3):
            assert_same(r.render(CAMERA), new.render(CAMERA))


def test_another_size_midway_begins_anew() -> None:
    """One size after another, each frame as if the others had never been."""
    for size in (SIZE, (1, 1), (7, 31), SIZE):
        with renderer(size) as r, renderer(size) as new:
            for _ in range(2):
                assert_same(r.render(CAMERA), new.render(CAMERA))
