"""The scene JSON of a state: the loader makes the same state of it."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from app.io.image import write_exr
from app.load import Parts, load_parts
from app.paths import data_dir
from app.scene import Camera, PointLight, SpotLight
from app.view.edited_scene import EditedScene
from app.view.scene_file import NAME, arguments, model_name, write_scene_json
from app.view.state import State

BOX = data_dir() / "cornell-box.obj"


@pytest.fixture(scope="module")
def parts() -> Parts:
    return load_parts(BOX)


def state_of(parts: Parts) -> State:
    scene = parts.scene
    return State((64, 48), scene.cameras[scene.default_camera].at(0.0), scene.lights[:parts.own_lights], "none")


def again(state: State, parts: Parts, folder: Path) -> Parts:
    write_scene_json(folder / "saved.json", state, parts)
    return load_parts(BOX, scene_json=folder / "saved.json")


def test_lights_cameras_and_bookmarks_come_back(parts: Parts, tmp_path: Path) -> None:
    lamp = replace(parts.scene.lights[0], position=(0.1, 1.2, -0.3))
    spot = SpotLight((0.5, 1.5, 0.0), (0.0, -1.0, 0.0), (1.0, 0.5, 0.25), 15.0, 30.0, 0.05)
    camera = Camera((0.1, 1.1, 3.3), (0.0, 0.9, 0.0), fov_y_deg=41.5)
    state = replace(state_of(parts), lights=(lamp, spot), camera=camera,
                    bookmarks=(("low", replace(camera, fov_y_deg=20)),))
    found = again(state, parts, tmp_path)
    assert found.scene.lights[:found.own_lights] == (lamp, spot)
    assert found.scene.cameras[found.scene.default_camera].at(0.0) == camera
    assert found.scene.cameras["low"].at(0.0).fov_y_deg == 20


def test_lights_of_emissive_surfaces_stay_apart(tmp_path: Path) -> None:
    parts = load_parts(BOX, lighting="emissive")
    assert parts.own_lights == 0 and len(parts.scene.lights) == 1
    state = replace(state_of(parts), lights=(PointLight((0.0, 1.0, 0.0), (1.0, 1.0, 1.0)),))
    found = again(state, parts, tmp_path)
    assert found.own_lights == 1
    assert found.scene.lights == (*state.lights, *parts.scene.lights)


def test_a_moved_object_is_where_the_viewer_shows_it(parts: Parts, tmp_path: Path) -> None:
    name = next(iter(parts.objects))
    state = replace(state_of(parts), places=((name, (0.25, 0.5, -0.125)),))
    stage = EditedScene(BOX, parts, tmp_path)
    still, shown = stage.scene(state_of(parts)), stage.scene(state)
    moved = again(state, parts, tmp_path).scene
    for index in parts.objects[name]:
        assert np.array_equal(shown.instances[index].transform_at(stage.time), moved.instances[index].transform_at(0.0))
        offset = shown.instances[index].transform_at(0.0) - still.instances[index].transform_at(0.0)
        assert offset[:3, 3].tolist() == [0.25, 0.5, -0.125]
    before = stage.time
    further = stage.scene(replace(state, places=((name, (0.5, 0.0, 0.0)),)))
    assert further.instances[parts.objects[name][0]].motion is shown.instances[parts.objects[name][0]].motion
    assert stage.time > before


def test_an_environment_keeps_its_image(tmp_path: Path) -> None:
    write_exr(tmp_path / "sky.exr", {"": np.full((4, 8, 3), 0.5, np.float32)})
    own = {"cameras": {"main": {"eye": [0, 1, 4], "target": [0, 1, 0]}}, "lightings": {"sky": {
        "lights": [], "emission": 0, "environment": {"type": "image", "file": "sky.exr"}}}}
    (tmp_path / "own.json").write_text(json.dumps(own))
    parts = load_parts(BOX, scene_json=tmp_path / "own.json")
    (tmp_path / "elsewhere").mkdir()
    found = again(state_of(parts), parts, tmp_path / "elsewhere")
    assert found.scene.environment is not None and parts.scene.environment is not None
    assert np.array_equal(found.scene.environment.radiance, parts.scene.environment.radiance)


def test_the_command_says_what_was_chosen(parts: Parts) -> None:
    state = replace(state_of(parts), model="bcnn-8", precision="float16", scale=0.25, taa=False, exposure=0.1)
    told = arguments(state, BOX, "saved.json", 4, ("final", "normal"), "exr", "cpu")
    assert told[0] == str(BOX)
    options = dict(zip(told[1::2], told[2::2], strict=False))
    assert options["--model"] == "bcnn-8-half"
    assert (options["--scale"], options["--exposure"], options["--settle"]) == ("0.25", "0.1", "4")
    assert told[-1] == "--no-taa"
    assert model_name(replace(state, model="none")) == "none"
    assert NAME == "view"
    both = replace(state, model="ember", environment="unshadowed_environment", bounces=2, scale=0.0, precision="")
    told = arguments(both, BOX, "saved.json", 4, ("final",), "png", "cpu")
    assert [name for option, name in pairwise(told) if option == "--model"] == ["ember", "unshadowed_environment"]
    assert told[told.index("--bounces") + 1] == "2"
    assert "--bounces" not in arguments(replace(both, model="none"), BOX, "saved.json", 4, ("final",), "png", "cpu")
