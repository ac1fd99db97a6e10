"""Real scenes with each of their lightings; and the same picture wherever and however large the world is."""

from __future__ import annotations

import functools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.load import embedded_scene, load_scene
from app.network.selection import find_model
from app.renderer import Renderer
from app.scene import DirectionalLight, Material, PointLight, RectLight, Scene, SpotLight
from app.settings import Settings
from tests.gl.scenes import Images, box, floor, make_scene, moved, sphere

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

SIZE = (160, 120)
NAMES = ["cornell-box", "sponza", "sibenik", "breakfast-room", "grey-white-room", "country-kitchen",
         "contemporary-bathroom", "stanford", "gltf-cases"]
EXPOSED = 0.2  # mean of the final picture that a scene's default lighting is set for


@functools.cache
def index(folder: Path) -> dict[str, dict[str, object]]:
    return {entry["name"]: entry for entry in json.loads((folder / "scenes.json").read_text())}


def test_no_scene_is_left_out(scenes: Path) -> None:
    assert set(index(scenes)) == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_real_scene(name: str, scenes: Path) -> None:
    entry = index(scenes)[name]
    whole = load_scene(scenes / str(entry["file"]))
    assert 0.998 * entry["triangles"] <= whole.triangles <= entry["triangles"]  # some have no area
    for lighting in entry["lightings"]:  # type: ignore[attr-defined]
        scene = whole if lighting == whole.lighting else load_scene(scenes / str(entry["file"]), lighting=lighting)
        settings = Settings(size=SIZE, outputs=("final", "depth"), check=True, timing=True, provider="cpu")
        with Renderer(scene, settings, find_model("radiosity")) as renderer:
            camera = scene.cameras[scene.default_camera].at(0.0)
            renderer.advance(camera)
            images = renderer.render(camera)
            counts = {p: e.get("non_finite", 0) for p, e in renderer.timing()["passes"].items()}
        mean = float(images["final"].mean())
        print(f"SCENE {name} {lighting}: mean {mean:.3f}, seen {np.mean(images['depth'] > 0):.2f}")
        assert not any(counts.values()), counts
        assert np.isfinite(images["final"]).all() and mean > 0.005
        if lighting == whole.lighting:
            assert EXPOSED / 2.5 <= mean <= EXPOSED * 2.5


def lights() -> tuple[PointLight | SpotLight | DirectionalLight | RectLight, ...]:
    return (PointLight((0.5, 1.5, 0.5), (0.4, 0.3, 0.2), 0.05),
            SpotLight((-0.8, 1.2, 0.8), (0.6, -1.0, -0.6), (0.8, 0.9, 1.0), 10.0, 35.0),
            DirectionalLight((0.3, -1.0, -0.4), (0.3, 0.3, 0.3), 0.5),
            RectLight((0.0, 1.9, -0.5), (0.4, 0, 0), (0, 0, 0.4), (1.0, 1.0, 1.0)))


def parts_scene() -> Scene:
    emissive = Material(emission=(0.5, 0.6, 0.2))
    polished = Material(albedo=(0.7, 0.2, 0.2), specular=(0.04,) * 3, roughness=0.3)
    scene = make_scene([floor(1.5), sphere((-0.3, 0.4, 0.0), 0.4, 32, polished),
                        box((0.3, 0.0, -0.2), (0.4, 0.6, 0.4)),
                        box((0.4, 0.0, 0.6), (0.1, 0.1, 0.1), emissive)], lights())
    camera = replace(scene.cameras["main"].keys[0], eye=(0.3, 1.0, 2.4), target=(0, 0.3, 0), up=(0, 1, 0))
    return replace(scene, cameras={"main": replace(scene.cameras["main"], keys=(camera,))})


@pytest.mark.parametrize("which", ["embedded", "parts"])
@pytest.mark.parametrize(("offset", "scale"), [((1e6, 0, 0), 1.0), ((-1e6, 1e6, 1e6), 1.0), ((0, 0, 0), 1e-3),
                                               ((0, 0, 0), 1e3), ((1e6, 1e6, 1e6), 1e3)])
def test_the_same_picture_anywhere_and_at_any_size(which: str, offset: tuple[float, float, float],
                                                   scale: float) -> None:
    """Within 2 of 255 for 99.5 % of the values: a shadow's edge may fall on another texel of its map."""
    scene = embedded_scene() if which == "embedded" else parts_scene()
    here, there = picture(scene), picture(moved(scene, offset, scale))
    difference = np.abs(here["display"].astype(int) - there["display"].astype(int))
    print(f"MOVED {which} {offset} {scale}: beyond 2: {np.mean(difference > 2):.3%}, max {difference.max()}, "
          f"mean {there['final'].mean() / here['final'].mean() - 1:+.4%}")
    assert np.mean(difference > 2) < 0.005
    assert there["final"].mean() == pytest.approx(here["final"].mean(), rel=2e-3)


def picture(scene: Scene) -> Images:
    with Renderer(scene, Settings(size=SIZE, provider="cpu"), find_model("radiosity")) as renderer:
        camera = scene.cameras[scene.default_camera].at(0.0)
        renderer.advance(camera)
        return renderer.render(camera)
