"""What comes without light: the studio, its ground, and the camera that frames an object."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from app.environment import row_solid_angles
from app.errors import SceneError, SettingsError
from app.load import lighting_of, load_for_editing, load_scene
from app.math3d import View
from app.scene import DirectionalLight, PointLight
from app.view.scene_file import write_scene_json
from tests.unit.load_helpers import Gltf, write_obj

WHITE = 0.9  # albedo


def save(folder, mesh, material=""):
    obj = "usemtl m\n" + "".join("v {} {} {}\n".format(*v) for v in mesh.vertices)
    obj += "".join("f {} {} {}\n".format(*f) for f in mesh.faces + 1)
    return write_obj(folder, obj, f"newmtl m\nKd 0.5 0.5 0.5\n{material}\n")


@pytest.fixture
def crate(tmp_path):
    return save(tmp_path, trimesh.creation.box((4, 1, 2)).apply_translation((7, -3, 2)))


def test_an_object_without_light_is_in_the_studio(crate):
    loaded = load_for_editing(crate)
    scene = loaded.scene
    (key,) = scene.lights
    assert (scene.lighting, loaded.own_lights, loaded.lighting.lights) == ("studio", 1, scene.lights)
    assert isinstance(key, DirectionalLight) and key.angular_radius_deg > 1, "its shadow is soft"
    assert scene.environment is not None
    assert any("no light" in n and "--no-studio" in n for n in scene.notices)
    camera = scene.cameras["auto"].at(0)
    right = np.cross(np.subtract(camera.target, camera.eye), camera.up)
    assert np.dot(key.direction, right) > 0 and key.direction[1] < 0, "it shines from the upper left"


def test_without_the_studio_it_is_dark(crate):
    scene = load_scene(crate, studio=False)
    assert (scene.lights, scene.environment, scene.lighting) == ((), None, "")
    assert any("black without the studio" in n for n in scene.notices)


def test_a_room_without_light_has_a_lamp_instead(tmp_path):
    walls = trimesh.creation.box((10, 3, 5))
    walls.invert()
    scene = load_scene(save(tmp_path, walls))
    assert isinstance(scene.lights[0], PointLight) and scene.environment is None and scene.lighting == ""
    assert load_scene(tmp_path / "scene.obj", studio=False).lights == ()


@pytest.mark.parametrize(("emission", "is_lit"), [(0.01, False), (0.07, False), (0.09, True), (3.0, True)])
def test_emission_that_lights_next_to_nothing_does_not_count(tmp_path, emission, is_lit):
    loaded = load_for_editing(save(tmp_path, trimesh.creation.box((1, 1, 1)), f"Ke {emission} {emission} {emission}"))
    scene = loaded.scene
    assert (scene.lighting == "studio") is not is_lit and (scene.environment is None) is is_lit
    assert loaded.own_lights == (0 if is_lit else 1)
    assert (len(scene.lights) > loaded.own_lights) is is_lit  # in the studio, faces glow and are no lights
    assert any("next to nothing" in n for n in scene.notices) is not is_lit


@pytest.mark.parametrize(("emission", "has_lamp"), [(0.01, True), (0.014, True), (0.018, False), (0.07, False)])
def test_dim_light_counts_in_a_room_where_it_stays(tmp_path, emission, has_lamp):
    walls = trimesh.creation.box((10, 3, 5))
    walls.invert()
    scene = load_scene(save(tmp_path, walls, f"Ke {emission} {emission} {emission}"))
    assert scene.lighting == "" and scene.environment is None
    assert any(isinstance(light, PointLight) for light in scene.lights) is has_lamp


def test_an_object_that_grows_from_nothing_is_in_the_studio(tmp_path):
    gltf = Gltf()
    times, scales = gltf.array(np.array([0, 1], np.float32)), gltf.array(np.array([[0, 0, 0], [1, 1, 1]], np.float32))
    gltf.json["animations"] = [{"samplers": [{"input": times, "output": scales}],
                                "channels": [{"sampler": 0, "target": {"node": 0, "path": "scale"}}]}]
    assert load_scene(gltf.save(tmp_path)).lighting == "studio"


def test_a_file_with_a_light_keeps_it_unless_the_studio_is_asked_for(tmp_path):
    gltf = Gltf()
    gltf.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    gltf.json["nodes"][0]["extensions"] = {"KHR_lights_punctual": {"light": 0}}
    path = gltf.save(tmp_path)
    assert [type(light) for light in load_scene(path).lights] == [PointLight]
    scene = load_scene(path, lighting="studio")
    assert [type(light) for light in scene.lights] == [DirectionalLight] and scene.environment is not None
    assert not any("studio" in n for n in scene.notices)


def test_a_scene_json_comes_first(crate):
    crate.with_suffix(".json").write_text(json.dumps({"lightings": {"dark": {"lights": []}}}))
    scene = load_scene(crate)
    assert (scene.lighting, scene.lights, scene.environment) == ("dark", (), None)
    assert load_scene(crate, lighting="studio").lighting == "studio"
    with pytest.raises(SceneError, match=r"no lighting 'stud'.*did you mean 'studio'"):
        load_scene(crate, lighting="stud")


def test_a_scene_without_lightings_names_the_studio(crate):
    with pytest.raises(SceneError, match=r"no lighting 'day' .expected one of: studio"):
        load_scene(crate, lighting="day")


def test_a_lighting_called_studio_is_named_once(crate):
    crate.with_suffix(".json").write_text(json.dumps({"lightings": {"studio": {"lights": []}}}))
    assert load_scene(crate, lighting="studio").lights == ()
    with pytest.raises(SceneError, match=r"no lighting 'day' .expected one of: studio\)"):
        load_scene(crate, lighting="day")


def test_options():
    assert [lighting_of("sun", None), lighting_of("sun", False), lighting_of(None, True)] == ["sun", "sun", "studio"]
    for lighting, studio, option in (("sun", True, "--studio"), ("studio", False, "--no-studio")):
        with pytest.raises(SettingsError, match=option):
            lighting_of(lighting, studio)


def irradiance(scene, normal):
    """Of a surface that sees everything, W/m²: a sum over the environment's rows, and the key light."""
    rows = scene.environment.radiance.mean(axis=(1, 2))
    polar = (np.arange(len(rows)) + 0.5) * np.pi / len(rows)
    azimuth = np.arange(64) * 2 * np.pi / 64
    towards = np.stack([np.sin(polar)[:, None] * np.cos(azimuth), np.cos(polar)[:, None] + 0 * azimuth,
                        np.sin(polar)[:, None] * np.sin(azimuth)], axis=-1)
    from_sky = (np.maximum(towards @ normal, 0).mean(axis=1) * rows * row_solid_angles(len(rows))).sum()
    (key,) = scene.lights
    return from_sky + key.irradiance[0] * max(0.0, -float(np.dot(key.direction, normal)))


def test_no_white_surface_is_clipped(crate):
    scene = load_scene(crate)
    normals = np.random.default_rng(0).normal(size=(500, 3))
    brightest = max(irradiance(scene, n / np.linalg.norm(n)) for n in normals) * WHITE / np.pi
    assert 0.75 < brightest < 1.0


def test_the_ground_is_below_and_looks_like_the_backdrop(crate):
    plain, scene = load_scene(crate), load_scene(crate, ground=True)
    ground = scene.materials[scene.meshes[-1].material]
    assert scene.bounds[0, 1] == pytest.approx(plain.bounds[0, 1], abs=1e-3) and scene.bounds[0, 1] < plain.bounds[0, 1]
    assert np.ptp(scene.bounds[:, 0]) > 5 * np.ptp(plain.bounds[:, 0])
    assert scene.cameras == plain.cameras
    shown = ground.albedo[0] * irradiance(scene, np.array([0.0, 1.0, 0.0])) / np.pi
    assert shown == pytest.approx(float(scene.environment.radiance[-1].mean()), rel=0.01)


@pytest.mark.parametrize("extents", [(4, 1, 2), (1, 5, 1), (1, 1, 1), (3, 0.01, 3), (0.01, 2, 2)])
def test_the_camera_fills_the_picture_with_the_object(tmp_path, extents):
    scene = load_scene(save(tmp_path, trimesh.creation.box(extents).apply_translation((50, 0, 0))))
    camera = scene.cameras["auto"].at(0)
    view = View.of(camera, (1024, 768), 1e-3)
    corners = np.add(trimesh.creation.box(extents).vertices, (50, 0, 0)) - view.eye
    clip = np.concatenate([corners, np.ones((8, 1))], axis=1) @ view.clip_from_relative().T
    image = clip[:, :2] / clip[:, 3:]
    low, high = image.min(axis=0), image.max(axis=0)
    assert (clip[:, 3] > 0).all()
    np.testing.assert_allclose(np.max(high - low), 1.8, atol=1e-3)  # nine tenths of the width or of the height
    np.testing.assert_allclose(low, -high, atol=1e-3)               # in the middle
    assert camera.eye[1] > 0 and camera.eye[2] > 0, "seen from above and from the front"


def test_the_viewer_saves_the_studio(crate, tmp_path):
    loaded = load_for_editing(crate)
    state = SimpleNamespace(lights=loaded.scene.lights, camera=loaded.scene.cameras["auto"].at(0), bookmarks=(),
                            object_offsets=())
    write_scene_json(tmp_path / "saved.json", state, loaded)
    again = load_scene(crate, scene_json=tmp_path / "saved.json")
    assert again.lights == loaded.scene.lights
    np.testing.assert_array_equal(again.environment.radiance, loaded.scene.environment.radiance)
