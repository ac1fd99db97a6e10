"""Upsampling of low-resolution light: planes, edges, thin things, the sky, and light that is no number."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from app.network.selection import find_model
from app.renderer import Renderer
from app.scene import Camera, PointLight, Scene
from app.settings import Settings
from tests.gl.scenes import make_scene, quad
from tests.override import override

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

Image = NDArray[np.float32]
SIZE = (256, 192)  # four pixels of a texel along an axis
SIZES = [SIZE, (150, 112)]  # the second with too few for four pixels to share their texels
CAMERA = Camera((0.0, 0.0, 2.0), (0.0, 0.0, 0.0))
LIGHTS = [PointLight((0.5, 1.0, 2.0), (5.0,) * 3)]
WALL = make_scene([quad((-4, -4, 0), (8, 0, 0), (0, 8, 0))], LIGHTS, CAMERA)


def upsampled(scene: Scene, light: Callable[[Image, Image], Image], size: tuple[int, int] = SIZE
              ) -> tuple[Image, Image]:
    """Indirect light and normals, when low-resolution light is ``light(filled, lowres_gbuffer)``."""
    settings = Settings(size, ("indirect", "normal"), provider="cpu", taa=False)
    with Renderer(scene, settings, find_model("radiosity")) as r:
        r.render(CAMERA)
        surface = r.resource("lowres_gbuffer")
        override(r, "indirect_filled", lambda filled: light(filled, surface))
        images = r.render(CAMERA)
    return images["indirect"], images["normal"]


@pytest.mark.parametrize("size", SIZES)
def test_light_between_texels_is_interpolated_on_a_plane(size: tuple[int, int]) -> None:
    def ramp(filled: Image, surface: Image) -> Image:
        filled = filled.copy()
        filled[..., :3] = (np.arange(filled.shape[1])[None, :, None] + 0.5) / filled.shape[1]
        return filled

    light, _ = upsampled(WALL, ramp, size)
    expected = np.broadcast_to((np.arange(size[0]) + 0.5) / size[0], light.shape[:2])
    inside = np.s_[8:-8, 8:-8]
    np.testing.assert_allclose(light[..., 0][inside], expected[inside], atol=1e-3)


def test_no_light_crosses_an_edge() -> None:
    """A wall of light 1 and a floor without: each pixel has that of its own surface."""
    scene = make_scene([quad((-4, -0.3, -1), (8, 0, 0), (0, 6, 0)), quad((-4, -0.3, 3), (8, 0, 0), (0, 0, -4))], LIGHTS,
                       CAMERA)

    def of_walls(filled: Image, surface: Image) -> Image:
        filled = filled.copy()
        filled[..., :3] = (surface[..., 2:3] > 0.5).astype(np.float32)
        return filled

    light, normal = upsampled(scene, of_walls)
    np.testing.assert_allclose(light[..., 0], (normal[..., 2] > 0.5).astype(np.float32), atol=0.05)


@pytest.mark.parametrize("size", SIZES)
def test_light_that_is_no_number_reaches_no_pixel(size: tuple[int, int]) -> None:
    def broken(filled: Image, surface: Image) -> Image:
        filled = np.ones_like(filled)
        filled[10, 10] = np.nan
        return filled

    light, _ = upsampled(WALL, broken, size)
    assert np.isfinite(light).all()
    assert (light == 1).mean() > 0.95


@pytest.mark.parametrize("size", SIZES)
def test_the_sky_has_none(size: tuple[int, int]) -> None:
    scene = make_scene([quad((-0.4, -0.4, 0), (0.8, 0, 0), (0, 0.8, 0))], LIGHTS, CAMERA)
    light, normal = upsampled(scene, lambda filled, surface: np.ones_like(filled), size)
    sky = (normal == 0).all(axis=-1)
    assert 0.2 < sky.mean() < 0.9
    assert not light[sky].any()
