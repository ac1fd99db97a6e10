"""A renderer that is given other lights draws what a new one would."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from app.load import embedded_scene
from app.renderer import Renderer
from app.scene import DirectionalLight, Light, PointLight, Scene
from app.settings import Settings
from tests.gl.scenes import box, floor, make_scene, slide

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
        renderer.set_exposure(2.0)
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


@pytest.mark.parametrize("light", [DirectionalLight((0.0, -1.0, 0.1), (1.0, 1.0, 1.0)),
                                   PointLight((0.0, 80.0, 0.0), (6400.0,) * 3)], ids=["sun", "lamp"])
def test_an_object_that_is_put_far_out_of_the_scene_keeps_its_shadow(light: Light) -> None:
    """As the viewer does, which writes another place into the motion of a scene that is drawn already."""
    settings, up = Settings((64, 48), ("direct",), taa=False), (0.0, 40.0, -4.0)

    def plate(*places: tuple[float, float, float]) -> Scene:
        motion = slide(range(len(places)), places)
        return make_scene([floor(2.0), box((-0.5, 0.1, -0.5), (1.0, 0.1, 1.0), motion=motion)], [light])

    scene = plate((0.0, 0.0, 0.0))
    going = replace(plate((0.0, 0.0, 0.0), up), bounds=scene.bounds)  # whose maps span both places, too
    camera = scene.cameras[scene.default_camera].at(0.0)
    with Renderer(scene, settings) as renderer, Renderer(going, settings) as fresh:
        before = renderer.render(camera)["direct"]
        scene.instances[1].motion.transforms[0, :3, 3] = up
        now, wanted = renderer.render(camera, 1e-6)["direct"], fresh.render(camera, 1.0)["direct"]
        assert np.array_equal(now, wanted)
        assert (now < 0.01 * before.max()).sum() > 20  # the shadow on the floor
        scene.instances[1].motion.transforms[0, :3, 3] = 0.0
        assert np.array_equal(renderer.render(camera, 2e-6)["direct"], before)
