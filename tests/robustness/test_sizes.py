"""Pictures of one pixel, of few, of odd sides, and very wide ones."""

from __future__ import annotations

import numpy as np
import pytest

from app.load import embedded_scene
from app.renderer import Renderer
from app.scene import Camera, DirectionalLight
from app.settings import Settings
from tests.gl.scenes import floor, make_scene
from tests.robustness.scenes import EVERYTHING, RADIOSITY

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

BOX = embedded_scene()
CAMERA = BOX.cameras[BOX.default_camera].at(0.0)
SIZES = [(1, 1), (2, 3), (191, 347), (4096, 16)]


@pytest.mark.parametrize("size", SIZES)
def test_the_middle_of_the_picture_is_the_same_at_any_size(size: tuple[int, int]) -> None:
    """The back wall of the box, at its distance, lit as in a picture of ordinary size."""
    def middle(size: tuple[int, int]) -> dict[str, np.ndarray]:
        settings = Settings(size=size, outputs=EVERYTHING, taa=False, provider="cpu")
        with Renderer(BOX, settings, RADIOSITY) as renderer:
            images = renderer.render(camera)
        assert all(image.shape[:2] == size[::-1] for image in images.values())
        assert all(np.isfinite(image).all() for image in images.values())
        return {name: image[size[1] // 2, size[0] // 2] for name, image in images.items()}

    camera = Camera(CAMERA.eye, (0.0, 1.6, -1.0), fov_y_deg=1.0)  # so narrow that all pixels see the same
    found, expected = middle(size), middle((64, 48))
    np.testing.assert_allclose(found["depth"], expected["depth"], rtol=0.01)
    np.testing.assert_allclose(found["normal"], expected["normal"], atol=0.01)
    np.testing.assert_allclose(found["albedo"], expected["albedo"], atol=1e-3)
    np.testing.assert_allclose(found["direct"], expected["direct"], rtol=0.05)
    np.testing.assert_allclose(found["indirect"], expected["indirect"], rtol=0.3)


@pytest.mark.parametrize("size", SIZES)
def test_a_moving_picture_of_any_size_has_history(size: tuple[int, int]) -> None:
    """A floor in the sun fills the picture: every pixel of every frame has the same, known, light."""
    sun = DirectionalLight((0.0, -1.0, 0.0), (2.0, 2.0, 2.0))
    settings = Settings(size=size, outputs=("final", "indirect"), provider="cpu")
    with Renderer(make_scene([floor(1e3)], [sun]), settings, RADIOSITY) as renderer:
        for step in (0, 0, 1, 2, 3):
            camera = Camera((0.01 * step, 0.5, 0.0), (0.01 * step, 0.0, 0.0), (0.0, 0.0, -1.0), 30.0)
            images = renderer.render(camera)
            assert images["indirect"].max() < 0.02  # a plane sees nothing of itself
            light = images["final"] - 0.5 * images["indirect"]
            np.testing.assert_allclose(light, 2.0 * 0.5 / np.pi, rtol=0.02)
