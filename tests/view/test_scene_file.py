"""The scene JSON of a state, which the loader reads back as the same state."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from app.io.image import write_exr
from app.load import LoadedScene, load_for_editing
from app.network.selection import UNSHADOWED
from app.paths import data_dir
from app.scene import Camera, PointLight, SpotLight
from app.view.edited_scene import EditedScene
from app.view.pick import Picker
from app.view.scene_file import VIEW_NAME, precise_model, render_arguments, write_scene_json
from app.view.state import State
from tests.unit.load_helpers import Gltf
from tests.unit.test_load_animation import animate

BOX = data_dir() / "cornell-box.obj"


@pytest.fixture(scope="module")
def loaded() -> LoadedScene:
    return load_for_editing(BOX)


def state_of(loaded: LoadedScene) -> State:
    scene = loaded.scene
    return State((64, 48), scene.cameras[scene.default_camera].at(0.0), scene.lights[:loaded.own_lights], "none")


def save_and_load(state: State, loaded: LoadedScene, folder: Path) -> LoadedScene:
    write_scene_json(folder / "saved.json", state, loaded)
    return load_for_editing(BOX, scene_json=folder / "saved.json")


def test_lights_cameras_and_bookmarks_are_restored(loaded: LoadedScene, tmp_path: Path) -> None:
    point = replace(loaded.scene.lights[0], position=(0.1, 1.2, -0.3))
    spot = SpotLight((0.5, 1.5, 0.0), (0.0, -1.0, 0.0), (1.0, 0.5, 0.25), 15.0, 30.0, 0.05)
    camera = Camera((0.1, 1.1, 3.3), (0.0, 0.9, 0.0), fov_y_deg=41.5)
    state = replace(state_of(loaded), lights=(point, spot), camera=camera,
                    bookmarks=(("low", replace(camera, fov_y_deg=20)),))
    saved = save_and_load(state, loaded, tmp_path)
    assert saved.scene.lights[:saved.own_lights] == (point, spot)
    assert saved.scene.cameras[saved.scene.default_camera].at(0.0) == camera
    assert saved.scene.cameras["low"].at(0.0).fov_y_deg == 20


def test_lights_of_emissive_surfaces_are_not_saved_as_lights(tmp_path: Path) -> None:
    loaded = load_for_editing(BOX, lighting="emissive")
    assert loaded.own_lights == 0 and len(loaded.scene.lights) == 1
    state = replace(state_of(loaded), lights=(PointLight((0.0, 1.0, 0.0), (1.0, 1.0, 1.0)),))
    saved = save_and_load(state, loaded, tmp_path)
    assert saved.own_lights == 1
    assert saved.scene.lights == (*state.lights, *loaded.scene.lights)


def test_a_moved_object_is_saved_where_the_viewer_shows_it(loaded: LoadedScene, tmp_path: Path) -> None:
    name = next(iter(loaded.objects))
    state = replace(state_of(loaded), object_offsets=((name, (0.25, 0.5, -0.125)),))
    edited = EditedScene(BOX, loaded, tmp_path)
    original, shown = edited.apply(state_of(loaded)), edited.apply(state)
    saved = save_and_load(state, loaded, tmp_path).scene
    for index in loaded.objects[name]:
        transform = shown.instances[index].transform_at(edited.time)
        assert np.array_equal(transform, saved.instances[index].transform_at(0.0))
        offset = transform - original.instances[index].transform_at(0.0)
        assert offset[:3, 3].tolist() == [0.25, 0.5, -0.125]
    before = edited.time
    further = edited.apply(replace(state, object_offsets=((name, (0.5, 0.0, 0.0)),)))
    assert further.instances[loaded.objects[name][0]].motion is shown.instances[loaded.objects[name][0]].motion
    assert edited.time > before


def test_a_file_with_z_up_stays_turned(tmp_path: Path) -> None:
    (tmp_path / "z.json").write_text('{"up_axis": "z"}')
    loaded = load_for_editing(BOX, scene_json=tmp_path / "z.json")
    saved = save_and_load(state_of(loaded), loaded, tmp_path)
    assert np.array_equal(saved.scene.bounds, loaded.scene.bounds)
    assert not np.allclose(saved.scene.bounds, load_for_editing(BOX).scene.bounds)


def test_an_environment_finds_its_image_from_another_folder(tmp_path: Path) -> None:
    write_exr(tmp_path / "sky.exr", {"": np.full((4, 8, 3), 0.5, np.float32)})
    content = {"cameras": {"main": {"eye": [0, 1, 4], "target": [0, 1, 0]}}, "lightings": {"sky": {
        "lights": [], "emission": 0, "environment": {"type": "image", "file": "sky.exr"}}}}
    (tmp_path / "sky.json").write_text(json.dumps(content))
    loaded = load_for_editing(BOX, scene_json=tmp_path / "sky.json")
    (tmp_path / "elsewhere").mkdir()
    saved = save_and_load(state_of(loaded), loaded, tmp_path / "elsewhere")
    assert saved.scene.environment is not None and loaded.scene.environment is not None
    assert np.array_equal(saved.scene.environment.radiance, loaded.scene.environment.radiance)


def test_the_command_names_all_choices(loaded: LoadedScene) -> None:
    state = replace(state_of(loaded), model="bcnn-8", precision="float16", scale=0.25, taa=False, exposure=0.1,
                    reflections=False)
    arguments = render_arguments(state, BOX, "saved.json", 4, ("final", "normal"), "exr", "cpu")
    assert arguments[0] == str(BOX)
    options = dict(zip(arguments[1::2], arguments[2::2], strict=False))
    assert options["--model"] == "bcnn-8-half"
    assert (options["--scale"], options["--exposure"], options["--settle"]) == ("0.25", "0.1", "4")
    assert arguments[-2:] == ["--no-reflections", "--no-taa"] and not {"--time", "--animation"} & set(arguments)
    later = render_arguments(replace(state, time=1.25), BOX, "saved.json", 4, ("final",), "exr", "cpu", "walk", "night")
    options = dict(zip(later[1::2], later[2::2], strict=False))
    assert (options["--time"], options["--animation"], options["--variant"]) == ("1.25", "walk", "night")
    assert precise_model(replace(state, model="none")) == "none"
    assert VIEW_NAME == "view"
    both = replace(state, model="ember", environment=UNSHADOWED, bounces=2, scale=0.0, precision="")
    arguments = render_arguments(both, BOX, "saved.json", 4, ("final",), "png", "cpu")
    assert [name for option, name in pairwise(arguments) if option == "--model"] == ["ember", UNSHADOWED]
    assert arguments[arguments.index("--bounces") + 1] == "2"
    without = render_arguments(replace(both, model="none"), BOX, "saved.json", 4, ("final",), "png", "cpu")
    assert "--bounces" not in without


def test_what_is_picked_is_where_the_animation_has_moved_it(tmp_path: Path) -> None:
    gltf = Gltf()
    animate(gltf, 0, "translation", [[0, 0, 0], [4, 0, 0]])
    loaded = load_for_editing(gltf.save(tmp_path))
    state = replace(state_of(loaded), camera=Camera((2.3, 0.3, 3.0), (2.3, 0.3, 0.0)))
    picker = Picker(loaded)
    assert picker.pick(state, (0.5, 0.5)) is None
    hit = picker.pick(replace(state, time=0.5), (0.5, 0.5))
    assert hit is not None and hit.object == "thing"
    np.testing.assert_allclose(hit.point, [2.3, 0.3, 0], atol=1e-5)
