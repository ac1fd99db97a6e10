"""Temporal upsampling: it converges to the supersampled picture, leaves no trails, and outlives changes of scale."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from app.errors import SettingsError
from app.load import embedded_scene
from app.network.selection import find_model
from app.renderer import Renderer
from app.scene import Camera, Material, PointLight, Scene
from app.settings import Settings
from tests.gl.scenes import box, draw, make_scene, quad, slide
from tests.override import override

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

SIZE = (96, 72)
FRAME = 1 / 30
BOX = embedded_scene()
CAMERA = BOX.cameras[BOX.default_camera].at(0.0)
Image = NDArray[np.float32]


def renderer(scene: Scene, render_scale: float, size: tuple[int, int] = SIZE) -> Renderer:
    return Renderer(scene, Settings(size=size, render_scale=render_scale, provider="cpu"))


def settled(scene: Scene, camera: Camera, render_scale: float, frames: int) -> Image:
    with renderer(scene, render_scale) as r:
        for _ in range(frames):
            r.advance(camera)
        return r.render(camera)["final"]


def psnr(image: Image, reference: Image) -> float:
    """Of radiance clamped to what is displayed."""
    return float(-10 * np.log10(np.square(np.clip(image, 0, 1) - np.clip(reference, 0, 1)).mean()))


def supersampled(scene: Scene, camera: Camera) -> Image:
    w, h = SIZE
    return draw(scene, (4 * w, 4 * h), camera=camera)["final"].reshape(h, 4, w, 4, 3).mean((1, 3))


def bars() -> tuple[Scene, Camera]:
    """Bright bars, each thinner than a pixel of a frame at half the size, before a dark wall."""
    bright, dark = Material(albedo=(0.9, 0.9, 0.9)), Material(albedo=(0.05, 0.05, 0.05))
    thin = [box((0.21 * i - 1, -0.9, 0), (0.025, 1.8, 0.025), bright) for i in range(10)]
    wall = quad((-3, -2, -1.0), (6, 0, 0), (0, 4, 0), dark)
    camera = Camera((0.0, 0.0, 3.0), (0.13, 0.04, 0.0))
    return make_scene([wall, *thin], [PointLight((0.5, 1.0, 3.0), (12.0,) * 3)], camera), camera


@pytest.mark.parametrize("make", [lambda: (BOX, CAMERA), bars], ids=["box", "bars"])
def test_a_still_loses_at_most_half_a_decibel(make: object) -> None:
    """Up to 50 dB, beyond which no difference is displayed: a step of 8 bits is 48 dB."""
    scene, camera = make()  # type: ignore[operator]
    reference = supersampled(scene, camera)
    full = psnr(settled(scene, camera, 1.0, 16), reference)
    half = psnr(settled(scene, camera, 0.5, 64), reference)
    print(f"STILL full {full:.2f} dB, half {half:.2f} dB")
    assert half >= min(full, 50) - 0.5


@pytest.mark.parametrize("render_scale", [0.5, 0.77])
@pytest.mark.parametrize("size", [(1, 1), (2, 3), (63, 47)])
def test_any_size(size: tuple[int, int], render_scale: float, small_ember: Path) -> None:
    with Renderer(BOX, Settings(size=size, render_scale=render_scale, provider="cpu"), small_ember) as r:
        for step in range(3):
            images = r.render(Camera((0.1 * step, 1.0, 3.0), (0, 1, 0)))
            assert images["final"].shape == (size[1], size[0], 3)
            assert images["display"].shape == (size[1], size[0], 3)
            assert np.isfinite(images["final"]).all()
        assert images["final"].max() > 0


def test_full_scale_has_the_passes_of_temporal_anti_aliasing() -> None:
    with renderer(BOX, 1.0) as full, renderer(BOX, 0.5) as half:
        assert {"taa"} == {p.name for p in full.plan.passes} - {p.name for p in half.plan.passes}
        assert {"upscale_guide", "upscale"} == {p.name for p in half.plan.passes} - {p.name for p in full.plan.passes}


def test_another_scale_goes_on_with_the_picture(small_ember: Path) -> None:
    with Renderer(BOX, Settings(size=SIZE, provider="cpu"), small_ember) as r:
        for _ in range(32):
            r.advance(CAMERA)
        before = r.render(CAMERA)["final"]
        changes = {}
        for render_scale in (0.5, 0.75, 1.0):
            r.set_render_scale(render_scale)
            changes[render_scale] = psnr(r.render(CAMERA)["final"], before)
        r.set_render_scale(0.5)
        r.cut()
        afresh = psnr(r.render(CAMERA)["final"], before)
        print(f"SWITCH {changes}, afresh {afresh:.1f} dB")
        assert min(changes.values()) > afresh + 10


def test_another_scale_takes_no_history_of_an_older_picture() -> None:
    with renderer(BOX, 1.0) as r:
        for render_scale, name in ((1.0, "taa_deviation"), (0.5, "guide_mean"), (1.0, "taa_deviation")):
            r.set_render_scale(render_scale)
            assert (r.resource(name) == 0).all()
            for _ in range(16):
                r.advance(CAMERA)
            assert (r.resource(name) > 0).any()


def test_what_a_size_has_made_is_as_in_a_renderer_of_that_size() -> None:
    with renderer(BOX, 1.0) as r, renderer(BOX, 0.5) as new:
        r.advance(CAMERA)
        r.set_render_scale(0.5)
        r.cut()
        for _ in range(2):
            np.testing.assert_array_equal(r.render(CAMERA)["final"], new.render(CAMERA)["final"])


def test_a_network_follows_the_size_of_its_grid() -> None:
    size = (400, 300)
    network = find_model("radiosity")
    with (Renderer(BOX, Settings(size=size, provider="cpu"), network) as r,
          Renderer(BOX, Settings(size=size, provider="cpu", render_scale=0.5), network) as new):
        r.advance(CAMERA)
        r.set_render_scale(0.5)
        r.cut()
        np.testing.assert_array_equal(r.render(CAMERA)["final"], new.render(CAMERA)["final"])


def passing_box() -> Scene:
    """A bright box that casts no shadow slides by before a grey wall, some two pixels a frame."""
    bright = Material(albedo=(0.9, 0.2, 0.1), is_light_proxy=True)
    mover = box((-0.2, 0.2, 0.0), (0.4, 0.5, 0.4), bright, slide([0, 2], [(-0.8, 0, 0), (1.6, 0, 0)]))
    wall = quad((-3, -1, -1.0), (6, 0, 0), (0, 4, 0), Material(albedo=(0.5, 0.5, 0.5)))
    return make_scene([wall, mover], [PointLight((0.5, 3.0, 3.0), (12.0,) * 3, 0.1)],
                      Camera((0.0, 0.8, 2.5), (0.0, 0.6, 0.0)))


def test_a_moving_edge_leaves_no_trail() -> None:
    scene = passing_box()
    camera = scene.cameras["main"].at(0.0)
    size = (160, 120)
    errors: dict[int, list[float]] = {2: [], 5: []}
    since = np.full(size[::-1], 1000)  # frames since the box was there
    with (renderer(scene, 0.5, size) as upscaled,
          Renderer(scene, Settings(size=size, outputs=("final", "albedo"), taa=False, provider="cpu")) as reference):
        for frame in range(20):
            expected = reference.render(camera, frame * FRAME)
            final = upscaled.render(camera, frame * FRAME)["final"]
            # Two pixels are one of the frame, which shows both surfaces at an edge.
            since = np.where(binary_dilation(expected["albedo"][..., 0] > 0.7, iterations=3), 0, since + 1)
            error = np.abs(final - expected["final"]).max(-1) / expected["final"].max(-1).clip(1e-3)
            for age, found in errors.items():
                found += error[since == age].tolist()
    for age, found in errors.items():
        print(f"TRAIL frame {age}: {len(found)} pixels, p99 {np.percentile(found, 99):.2%}, max {max(found):.2%}")
        assert len(found) > 200
        assert np.percentile(found, 99) <= 0.02


@functools.cache
def after_poison(resource: str, value: float | None) -> list[NDArray[np.int_]]:
    """The frames after one in which a texel of ``resource`` was replaced."""
    def poisoned(image: Image) -> Image:
        image = image.copy()
        image[20, 25] = value
        return image

    with renderer(BOX, 0.5, (64, 48)) as r:
        for _ in range(5):
            r.advance(CAMERA)
        override(r, resource, None if value is None else poisoned)
        r.advance(CAMERA)
        override(r, resource, None)
        frames = [r.render(CAMERA) for _ in range(4)]
    assert all(np.isfinite(frame["final"]).all() for frame in frames)
    return [frame["display"].astype(int) for frame in frames]


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("resource", ["taa", "lit", "motion", "depth", "guide_mean", "guide_deviation", "guide_motion"])
def test_a_poisoned_texel_stays_what_it_is(resource: str, value: float) -> None:
    clean = after_poison("taa", None)
    found = [int((np.abs(a - b).max(-1) > 4).sum()) for a, b in zip(after_poison(resource, value), clean, strict=True)]
    print(f"POISON {resource} {value}: {found} pixels differ")
    assert max(found) <= 9  # those that the texel of the frame, or a pixel's filtered history, reaches


@pytest.mark.parametrize(("settings", "expected"), [
    ({"render_scale": 0.4}, "bad scale 0.4"), ({"render_scale": float("nan")}, "bad scale nan"),
    ({"render_scale": 0.5, "taa": False}, "expected 1 without it"),
    ({"render_scale": 0.5, "outputs": ("final", "normal")}, "can't draw normal"),
])
def test_what_does_not_fit_a_render_scale_is_an_error(settings: dict[str, object], expected: str) -> None:
    with pytest.raises(SettingsError, match="render_scale") as error:
        Settings(**settings)  # type: ignore[arg-type]
    assert expected in str(error.value)
