"""An image is the same whether it is asked for alone or with others."""

from __future__ import annotations

import numpy as np
import pytest

from app.golden.scenes import area_lights
from app.renderer import Renderer
from app.settings import Settings

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]
SIZE = (48, 36)
AOVS = ("albedo", "normal", "depth", "position", "motion", "direct", "specular", "emission", "lit")


def test_an_image_does_not_depend_on_what_else_is_written() -> None:
    scene = area_lights()  # its emission comes from a texture
    camera = scene.cameras[scene.default_camera].at(0.0)

    def draw(*outputs: str) -> dict[str, np.ndarray]:
        with Renderer(scene, Settings(size=SIZE, outputs=outputs, taa=False)) as renderer:
            return renderer.render(camera)

    together = draw(*AOVS)
    assert together["emission"].max() > 1
    for name in AOVS:  # other shaders may round the last bit of a half float differently
        np.testing.assert_allclose(draw(name)[name], together[name], rtol=2**-10, err_msg=name)
