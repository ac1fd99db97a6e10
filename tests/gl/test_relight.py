"""A renderer that is given other lights draws what a new one would."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.load import embedded_scene
from app.renderer import Renderer
from app.scene import DirectionalLight, PointLight
from app.settings import Settings

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

SCENE = embedded_scene()
CAMERA = SCENE.cameras[SCENE.default_camera].at(0.0)
SETTINGS = Settings((64, 48), ("final", "direct"))
LAMP = SCENE.lights[0]
MOVED = replace(LAMP, position=(0.5, 1.2, 0.3), intensity=(1.0, 2.0, 3.0), radius=0.05)


def draw(renderer: Renderer) -> dict[str, np.ndarray]:
    renderer.cut()
    return renderer.render(CAMERA)


def test_it_draws_what_a_new_renderer_would() -> None:
    with Renderer(SCENE, SETTINGS, "ssgi") as renderer, \
            Renderer(SCENE.with_lights(MOVED), replace(SETTINGS, exposure=2.0), "ssgi") as fresh:
        before = draw(renderer)
        assert renderer.relight((MOVED,))
        renderer.expose(2.0)
        now, wanted = draw(renderer), draw(fresh)
        assert all(np.array_equal(now[name], wanted[name]) for name in wanted)
        assert np.abs(now["direct"] - before["direct"]).mean() > 0.05


@pytest.mark.parametrize("lights", [
    (), (LAMP, MOVED), (DirectionalLight((0.0, -1.0, 0.0), (1.0, 1.0, 1.0), 0.5),),
    (replace(LAMP, radius=0.0),),                          # a hard shadow needs another map
    (replace(LAMP, intensity=(1e6, 1e6, 1e6)),),           # another scale
    (PointLight(LAMP.position, (1.0, 1.0, 1.0)), LAMP),
])
def test_lights_that_need_other_shaders_change_nothing(lights: tuple[object, ...]) -> None:
    with Renderer(SCENE, SETTINGS) as renderer:
        before = draw(renderer)
        assert not renderer.relight(lights)
        assert renderer.scene.lights == SCENE.lights
        now = draw(renderer)
        assert all(np.array_equal(now[name], before[name]) for name in now)


def test_times_of_the_newest_frames_alone() -> None:
    with Renderer(SCENE, replace(SETTINGS, timing=True)) as renderer:
        for _ in range(4):
            draw(renderer)
        newest, all_ = renderer.timing(1)["frame"]["cpu_ms"], renderer.timing()["frame"]["cpu_ms"]
        assert newest["median"] == newest["p95"]
        assert all_["median"] < all_["p95"]
