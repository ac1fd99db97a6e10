"""A frame that is given up between two passes leaves no trace in those after it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import sleep

import numpy as np
import pytest

from app.load import embedded_scene
from app.network.selection import Model
from app.renderer import Renderer
from app.scene import Camera, Motion, PointLight
from app.settings import Settings

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

BOX = embedded_scene()
SETTINGS = Settings((64, 48), ("final", "direct", "indirect", "motion", "position"), provider="cpu")
CAMERA = BOX.cameras[BOX.default_camera].at(0.0)
BESIDE = replace(CAMERA, eye=(0.2, 1.0, CAMERA.eye[2]))
# What a viewer's drags do: the camera, an object (by the time), the light, and nothing.
WALK: list[tuple[Camera, float, float]] = [
    (CAMERA, 0.0, 1.0), (BESIDE, 0.0, 1.0), (BESIDE, 0.5, 1.0), (BESIDE, 0.5, 1.0), (BESIDE, 0.5, 2.0),
    (CAMERA, 1.0, 2.0)]


def moving_box() -> object:
    """The embedded scene, whose last object rises."""
    rise = np.tile(np.eye(4), (2, 1, 1))
    rise[1, 1, 3] = 0.4
    return replace(BOX, instances=(*BOX.instances[:-1], replace(BOX.instances[-1], motion=Motion(np.array([0.0, 1.0]),
                                                                                                 rise))))


def wanted_for(passes: int) -> Callable[[], bool]:
    """Says yes so many times."""
    left = iter([True] * passes)
    return lambda: next(left, False)


def walked(model: Model, disturb: Callable[[Renderer, Camera, float], None]) -> list[dict[str, np.ndarray]]:
    frames = []
    with Renderer(moving_box(), SETTINGS, model) as renderer:
        for camera, time, strength in WALK:
            lamp = BOX.lights[0]
            assert isinstance(lamp, PointLight)
            assert renderer.relight((replace(lamp, intensity=(strength, 1.0, 1.0)),))
            frames.append(renderer.render(camera, time))
            disturb(renderer, camera, time)
    return frames


def give_up_after_each_pass(renderer: Renderer, camera: Camera, time: float) -> None:
    for passes in range(len(renderer.plan.passes)):
        assert not renderer.advance(camera, time, wanted_for(passes))


@pytest.mark.parametrize("model", ["ssgi", "ember"])
def test_frames_after_it_are_the_same_to_the_bit(model: str, small_ember: Path) -> None:
    chosen = small_ember if model == "ember" else model
    undisturbed = walked(chosen, lambda renderer, camera, time: None)
    disturbed = walked(chosen, give_up_after_each_pass)
    for one, other in zip(undisturbed, disturbed, strict=True):
        assert all(one[name].tobytes() == other[name].tobytes() for name in one)


def test_a_frame_that_stays_wanted_is_drawn() -> None:
    with Renderer(BOX, SETTINGS) as renderer, Renderer(BOX, SETTINGS) as other:
        renderer.render(CAMERA)
        other.render(CAMERA)
        assert renderer.advance(CAMERA, 0.0, lambda: True)
        assert np.array_equal(renderer.read("final"), other.render(CAMERA)["final"])


def test_the_time_that_asking_takes_is_none_of_the_frame_s() -> None:
    def slowly() -> bool:
        sleep(0.1)
        return True

    with Renderer(BOX, replace(SETTINGS, timing=True)) as renderer:
        renderer.advance(CAMERA)
        renderer.reset_timing()
        assert renderer.advance(CAMERA, 0.0, slowly)
        times = renderer.timing()
        passes = sum(each["cpu_ms"]["median"] for each in times["passes"].values())
        assert passes <= times["frame"]["cpu_ms"]["median"] < passes + 100  # all in all it waited several times that


def test_the_times_of_its_passes_are_forgotten() -> None:
    with Renderer(BOX, replace(SETTINGS, timing=True)) as renderer:
        renderer.advance(CAMERA)
        before = renderer.timing()
        for passes in range(len(renderer.plan.passes)):
            assert not renderer.advance(CAMERA, 0.0, wanted_for(passes))
        assert renderer.timing() == before
