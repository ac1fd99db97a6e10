"""The scene JSON."""

from __future__ import annotations

import json

import jsonschema
import numpy as np
import OpenImageIO as oiio
import pytest

from app.environment import radiance_along
from app.errors import SceneError
from app.io.checked_json import SCHEMA
from app.io.image import write_exr
from app.load import load_camera, load_scene
from app.load.sidecar import parse_camera
from app.scene import DirectionalLight, PointLight, RectLight, SpotLight
from app.view.state import camera_to_json
from tests.unit.load_helpers import QUAD, Gltf, world, write_obj

EYE = {"eye": [0, 0, 5], "target": [0, 0, 0]}
LENS = {"fx": 500.0, "fy": 400.0, "cx": 320.0, "cy": 240.0, "width": 640.0, "height": 400.0}
POINT = {"type": "point", "position": [0, 1, 0], "intensity": [1, 2, 3]}


def lit(*lights, **more):
    return {"lightings": {"only": {"lights": list(lights), **more}}}


@pytest.fixture
def load(tmp_path):
    def load(content, **options):
        path = write_obj(tmp_path, "o quad\nusemtl a\n" + QUAD + "f 1 2 3 4\n", "newmtl a\nKe 2 2 2\n")
        path.with_suffix(".json").write_text(content if isinstance(content, str) else json.dumps(content))
        return load_scene(path, **options)

    return load


def test_schema_is_a_valid_schema():
    from importlib import resources

    schema = json.loads(resources.files("app.data").joinpath(SCHEMA).read_text("utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)


def test_a_file_with_z_up_is_turned_before_its_objects_move(load):
    scene = load({"up_axis": "z", "objects": {"quad": {"keys": [{"time": 0}, {"time": 1, "translate": [0, 3, 0]}]}}})
    np.testing.assert_allclose(scene.bounds, [[0, 0, -1], [1, 0, 0]], atol=1e-7)
    instance = scene.instances[0]
    assert (world(scene, instance) == [0.0, 0.0, -1.0]).all(axis=-1).any()  # the corner at (0, 1, 0)
    moved = instance.transform_at(1.0) @ np.linalg.inv(instance.transform_at(0.0))
    np.testing.assert_allclose(moved, [[1, 0, 0, 0], [0, 1, 0, 3], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-12)


def test_gltf_files_have_y_up(tmp_path):
    path = Gltf().save(tmp_path)
    path.with_suffix(".json").write_text('{"up_axis": "z"}')
    with pytest.raises(SceneError, match=r"up_axis: scene\.gltf has y up"):
        load_scene(path)


def test_every_light(load):
    scene = load(lit(
        POINT, POINT | {"type": "sphere", "radius": 0.5},
        {"type": "spot", "position": [0, 1, 0], "target": [0, -1, 0], "intensity": [1, 1, 1], "inner_deg": 10,
         "outer_deg": 20, "radius": 0.1},
        {"type": "spot", "position": [0, 1, 0], "direction": [0, 0, 9], "intensity": [1, 1, 1], "inner_deg": 10,
         "outer_deg": 10},
        {"type": "directional", "direction": [0, -2, 0], "irradiance": [4, 4, 4], "angular_radius_deg": 0.27},
        {"type": "rectangle", "center": [0, 3, 0], "edge_u": [2, 0, 0], "edge_v": [0, 0, 1], "radiance": [9, 9, 9],
         "two_sided": True}, emission=0))
    assert scene.lights == (
        PointLight((0, 1, 0), (1, 2, 3)), PointLight((0, 1, 0), (1, 2, 3), 0.5),
        SpotLight((0, 1, 0), (0, -1, 0), (1, 1, 1), 10, 20, 0.1), SpotLight((0, 1, 0), (0, 0, 1), (1, 1, 1), 10, 10),
        DirectionalLight((0, -1, 0), (4, 4, 4), 0.27),
        RectLight((0, 3, 0), (2, 0, 0), (0, 0, 1), (9, 9, 9), True))


def test_emission_factor_scales_and_switches_off(load):
    dark, dim = load(lit(POINT, emission=0)), load(lit(emission=0.5))
    assert not dark.materials[0].emits and len(dark.lights) == 1
    assert dim.materials[0].emission == (1, 1, 1) and dim.materials[0].is_light_proxy
    assert dim.lights[0].radiance == (1, 1, 1)


def test_an_error_about_an_image_of_the_sky_names_its_key(load):
    with pytest.raises(SceneError, match=r"lightings\.\w+\.environment\.file: .*gone\.hdr: no such image file"):
        load(sky(type="image", file="gone.hdr"))


def test_an_environment_may_be_the_only_light(load):
    sky = {"type": "constant", "radiance": [1, 1, 1]}
    scene = load({"lightings": {"overcast": {"emission": 0, "environment": sky}}})
    assert scene.lights == () and scene.environment is not None


def test_defaults_and_choices(load):
    content = {"cameras": {"a": EYE, "b": EYE}, "default": {"camera": "b", "lighting": "two"},
               "lightings": {"one": {"lights": [POINT]}, "two": {"lights": []}}}
    scene = load(content)
    assert (scene.default_camera, scene.lighting) == ("b", "two")
    assert load(content, lighting="one").lighting == "one"
    with pytest.raises(SceneError, match="one, two"):
        load(content, lighting="three")
    del content["default"]
    assert (load(content).default_camera, load(content).lighting) == ("a", "one")


def test_projections_interpolate_and_are_written_as_they_are_read(load):
    other = {k: 2.0 * v for k, v in LENS.items()}
    scene = load({"cameras": {
        "parallel": {"keys": [{"time": t, **EYE, "orthographic_height": 2 + t} for t in (0, 2)]},
        "lens": {"keys": [{"time": 0, **EYE, "intrinsics": LENS}, {"time": 1, **EYE, "intrinsics": other}]},
        "pinhole": EYE}})
    parallel, lens = scene.cameras["parallel"].at(1), scene.cameras["lens"].at(0.5)
    assert (parallel.orthographic_height, parallel.intrinsics) == (3, None)
    assert (lens.orthographic_height, lens.intrinsics.fx, lens.intrinsics.height) == (None, 750, 600)
    for camera in (parallel, lens, scene.cameras["pinhole"].at(0)):
        assert parse_camera(json.loads(json.dumps(camera_to_json(camera))), "camera") == camera


def test_key_framed_camera_interpolates(load):
    keys = [{"time": 0, **EYE}, {"time": 2, "eye": [4, 0, 5], "target": [0, 0, 0], "fov_y_deg": 65}]
    path = load({"cameras": {"fly": {"keys": keys}}}).cameras["fly"]
    assert path.moves and path.at(1).eye == (2, 0, 5) and path.at(1).fov_y_deg == 55


def test_objects_move_about_their_own_centre(load):
    scene = load({"objects": {"quad": {"keys": [
        {"time": 0}, {"time": 1, "translate": [0, 0, 3], "rotate_deg": [0, 0, 360], "scale": 2}]}}})
    (instance,) = scene.instances
    corners = scene.meshes[0].positions

    def at(time):
        matrix = instance.transform_at(time)
        return corners @ matrix[:3, :3].T + matrix[:3, 3]

    np.testing.assert_allclose(at(0).mean(axis=0), [0.5, 0.5, 0], atol=1e-6)
    np.testing.assert_allclose(at(1).mean(axis=0), [0.5, 0.5, 3], atol=1e-6)
    np.testing.assert_allclose(np.ptp(at(1), axis=0), [2, 2, 0], atol=1e-6)
    # Half-way, it is upside down and has kept its size: interpolating only the two matrices would collapse it.
    np.testing.assert_allclose(np.linalg.norm(at(0.25) - at(0.25).mean(axis=0), axis=1), 1.25 * np.sqrt(0.5), rtol=1e-3)
    assert any("moves" in n for n in scene.notices), "a moving emitter is not an analytic light"


def test_axis_and_angle(load):
    scene = load({"objects": {"quad": {"keys": [
        {"time": 0}, {"time": 1, "rotate_deg": {"axis": [0, 3, 0], "angle_deg": 90}}]}}})
    rotation = scene.instances[0].transform_at(1)
    np.testing.assert_allclose(rotation[:3, :3] @ [1, 0, 0], [0, 0, -1], atol=1e-9)


BAD_CAMERAS = [
    ({"eye": [0, 0, 5], "target": [0, 0, 0], "fov_y": 3}, "cameras.main.fov_y", "did you mean 'fov_y_deg'"),
    ({"eye": [0, 0, 5]}, "cameras.main", "target"),
    (EYE | {"fov_y_deg": 180}, "cameras.main.fov_y_deg", "less than 180"),
    (EYE | {"eye": [0, 0]}, "cameras.main.eye", "at least 3"),
    (EYE | {"orthographic_height": 0}, "cameras.main.orthographic_height", "at least 1e-15"),
    (EYE | {"intrinsics": LENS | {"fx": 0}}, "cameras.main.intrinsics.fx", "at least 0.001"),
    (EYE | {"intrinsics": {"fx": 1}}, "cameras.main.intrinsics", "fy"),
    (EYE | {"intrinsics": LENS, "orthographic_height": 2}, "cameras.main", "at most one"),
    ({"keys": [{"time": 0, **EYE}, {"time": 1, **EYE, "orthographic_height": 2}]}, "cameras.main.keys", "in every key"),
    (EYE | {"eye": [0, 0, "x"]}, r"cameras.main.eye\[2\]", "a number"),
    (EYE | {"eye": [0, 0, 0]}, "cameras.main", "different points"),
    (EYE | {"up": [0, 0, 1]}, "cameras.main.up", "at an angle to the view"),
    ({"keys": [{"time": 1, **EYE}, {"time": 1, **EYE}]}, r"cameras.main.keys\[1\].time", "increasing"),
    ({"keys": []}, "cameras.main.keys", "at least 1"),
]


@pytest.mark.parametrize(("camera", "where", "expected"), BAD_CAMERAS)
def test_camera_errors_name_the_key(load, camera, where, expected):
    with pytest.raises(SceneError, match=rf"scene\.json: {where}.*{expected}"):
        load({"cameras": {"main": camera}})


SPOT = {"type": "spot", "position": [0, 0, 0], "direction": [0, 1, 0], "intensity": [1, 1, 1], "inner_deg": 30,
        "outer_deg": 40}
RECTANGLE = {"type": "rectangle", "center": [0, 0, 0], "edge_u": [1, 0, 0], "edge_v": [0, 1, 0], "radiance": [1, 1, 1]}
BAD_LIGHTS = [
    (POINT | {"type": "pont"}, "type", "did you mean 'point'"),
    (POINT | {"radius": -1}, "radius", "at least 0"),
    (POINT | {"intensity": 5}, "intensity", "a list of 3 numbers"),
    (POINT | {"intensity": [1, -1, 1]}, r"intensity\[1\]", "at least 0"),
    (POINT | {"type": "sphere"}, "", "radius"),
    (SPOT | {"outer_deg": 20}, "outer_deg", "at least inner_deg"),
    (SPOT | {"outer": 20}, "outer", "did you mean 'outer_deg'"),
    (SPOT | {"target": [0, 1, 0]}, "", "exactly one"),
    (SPOT | {"direction": [0, 0, 0]}, "direction", "not zero"),
    (RECTANGLE | {"edge_v": [1, 1, 0]}, "", "right angle"),
]


@pytest.mark.parametrize(("light", "key", "expected"), BAD_LIGHTS)
def test_light_errors_name_the_key(load, light, key, expected):
    dot = r"\." if key else ""
    with pytest.raises(SceneError, match=rf"lightings\.only\.lights\[1\]{dot}{key}.*{expected}"):
        load(lit(POINT, light))


def motion_with(**key):
    return {"objects": {"quad": {"keys": [{"time": 0, **key}]}}}


HUGE = [
    ({"cameras": {"c": EYE | {"eye": [0, 1e200, 5]}}}, r"cameras\.c\.eye\[1\]", r"at most 1e\+15"),
    ({"cameras": {"c": EYE | {"target": [0, 0, -1e16]}}}, r"cameras\.c\.target\[2\]", r"at least -1e\+15"),
    ({"cameras": {"c": {"keys": [{"time": 1e300, **EYE}]}}}, r"keys\[0\]\.time", r"at most 1e\+09"),
    (lit(POINT | {"position": [1e300, 0, 0]}), r"lights\[0\]\.position\[0\]", r"at most 1e\+15"),
    (lit(POINT | {"radius": 1e40}), r"lights\[0\]\.radius", r"at most 1e\+15"),
    (lit(POINT | {"intensity": [1, 1e39, 1]}), r"lights\[0\]\.intensity\[1\]", r"at most 1e\+30"),
    (lit(RECTANGLE | {"edge_u": [1e20, 0, 0]}), r"lights\[0\]\.edge_u\[0\]", r"at most 1e\+15"),
    (lit(emission=1e300), r"only\.emission", r"at most 1e\+30"),
    (motion_with(translate=[0, 1e200, 0]), r"translate\[1\]", r"at most 1e\+15"),
    (motion_with(rotate_deg=[0, 1e300, 0]), r"rotate_deg\[1\]", r"at most 1e\+09"),
    (motion_with(rotate_deg={"axis": [0, 1, 0], "angle_deg": -1e300}), r"rotate_deg\.angle_deg", r"at least -1e\+09"),
    (motion_with(scale=1e200), r"scale", r"at most 1e\+15"),
    (motion_with(scale=[1, 1, 1e200]), r"scale\[2\]", r"at most 1e\+15"),
]


@pytest.mark.parametrize(("content", "where", "expected"), HUGE)
def test_errors_for_numbers_out_of_range_name_the_key(load, content, where, expected):
    with pytest.raises(SceneError, match=rf"scene\.json: .*{where}: .* is out of range \(expected {expected}\)$"):
        load(content)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("content", [
    {"cameras": {"c": {"eye": [1e15, -1e15, 1e15], "target": [0, 0, 0], "up": [0, 1e15, 0]}}},
    lit(POINT | {"position": [1e15, 1e15, 1e15], "intensity": [1e30, 0, 0], "radius": 1e15},
        RECTANGLE | {"center": [0, -1e15, 0], "edge_u": [1e15, 0, 0], "edge_v": [0, 1e15, 0]}, emission=1e30),
    lit(SPOT | {"direction": [1e15, 1e15, 0]}),
    motion_with(translate=[1e14, 0, 0], rotate_deg=[1e9, 0, 0], scale=1e14),
])
def test_numbers_at_their_bounds_are_accepted(load, content):
    scene = load(content)
    assert np.isfinite(scene.bounds).all() and np.isfinite(scene.longest_edge)


@pytest.mark.parametrize(("content", "match"), [
    ("{", "not a JSON file"), ("[]", "an object"), ('{"cameras": NaN}', "finite"), ("[" * 100_000, "too deeply"),
    ('{"cameras": {}, "cameras": {}}', "'cameras' is there twice"),
    ('{"lightings": {"a": {"lights": [], "emission": 1e999}}}', "finite"),
    ({"camera": {}}, "did you mean 'cameras'"), ({"default": {"camera": "x"}}, "default.camera"),
    ({"objects": {"qud": {"keys": [{"time": 0}]}}}, r"objects\.qud.*did you mean 'quad'"),
    ({"objects": {"quad": {"keys": [{"time": 0, "rotate_deg": {"axis": [0, 1, 0]}}]}}}, "rotate_deg.*angle_deg"),
    ({"objects": {"quad": {"keys": [{"time": 0, "scale": 0}]}}}, "scale.*more than 0"),
])
def test_other_errors(load, content, match):
    with pytest.raises(SceneError, match=match) as caught:
        load(content)
    assert "scene.json" in str(caught.value) and "\n" not in str(caught.value)


def test_a_scene_json_from_another_folder(load, tmp_path):
    other = tmp_path / "other.json"
    other.write_text(json.dumps({"cameras": {"else": EYE}}))
    assert load({}, scene_json=other).default_camera == "else"
    with pytest.raises(SceneError, match=r"gone\.json"):
        load({}, scene_json=tmp_path / "gone.json")


def test_camera_file(tmp_path):
    file = tmp_path / "camera.json"
    file.write_text(json.dumps(EYE | {"fov_y_deg": 30}))
    assert load_camera(file).at(7).fov_y_deg == 30
    file.write_text(json.dumps(EYE | {"fov": 30}))
    with pytest.raises(SceneError, match=r"camera\.json: fov.*fov_y_deg"):
        load_camera(file)


def test_a_node_name_moves_all_its_descendants(tmp_path):
    from tests.unit.load_helpers import Gltf

    gltf = Gltf()
    gltf.json["nodes"] = [{"name": "parent", "children": [1, 2]},
                          {"name": "left", "mesh": 0, "translation": [-3, 0, 0]},
                          {"name": "right", "mesh": 0, "translation": [3, 0, 0]}]
    path = gltf.save(tmp_path)
    path.with_suffix(".json").write_text(json.dumps(
        {"objects": {"parent": {"keys": [{"time": 0, "rotate_deg": [0, 180, 0]}]}}}))
    scene = load_scene(path)
    left = next(i for i in scene.instances if i.name == "left")
    at_rest = world(scene, left).reshape(-1, 3)
    moved = at_rest @ left.motion.transforms[0][:3, :3].T + left.motion.transforms[0][:3, 3]
    assert at_rest[:, 0].max() < 0 < moved[:, 0].min()


def sky(**spec):
    return lit(POINT, environment=spec)


def test_constant_and_gradient_environments(load):
    constant = load(sky(type="constant", radiance=[1, 2, 3])).environment
    np.testing.assert_array_equal(radiance_along(constant, np.eye(3)), [[1, 2, 3]] * 3)
    gradient = load(sky(type="gradient", zenith=[0, 0, 4], horizon=[0, 2, 0], ground=[1, 0, 0])).environment
    angle = np.radians([90, 45, 1, -1, -90])
    along = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    np.testing.assert_allclose(radiance_along(gradient, along), [
        [0, 0, 4], [0, 1, 2], [0, 2 * 89 / 90, 4 / 90], [1, 0, 0], [1, 0, 0]], atol=0.01)


def test_an_image_environment(load, tmp_path):
    pixels = np.random.default_rng(0).random((4, 8, 3), np.float32)
    write_exr(tmp_path / "sky.exr", {"": pixels})
    environment = load(sky(type="image", file="sky.exr", scale=[1, 2, 0.5], rotation_deg=30)).environment
    np.testing.assert_allclose(environment.radiance, pixels * np.float32([1, 2, 0.5]))
    assert environment.rotation_deg == 30


def test_an_hdr_and_a_grey_image(load, tmp_path):
    spec = oiio.ImageSpec(8, 4, 3, oiio.FLOAT)
    output = oiio.ImageOutput.create(str(tmp_path / "sky.hdr"))
    output.open(str(tmp_path / "sky.hdr"), spec)
    output.write_image(np.full((4, 8, 3), [1000.0, 250.0, 0.5], np.float32))
    output.close()
    environment = load(sky(type="image", file="sky.hdr")).environment
    np.testing.assert_allclose(environment.radiance, np.broadcast_to([1000.0, 250.0, 0.5], (4, 8, 3)), atol=4)
    write_exr(tmp_path / "grey.exr", {"": np.full((2, 4, 1), 3.0, np.float32)})
    assert (load(sky(type="image", file="grey.exr")).environment.radiance == 3).all()


def test_invalid_values_in_an_image_are_black_with_a_notice(load, tmp_path):
    pixels = np.ones((4, 8, 3), np.float32)
    pixels[0, :3, 0] = np.nan, np.inf, -1
    write_exr(tmp_path / "sky.exr", {"": pixels})
    scene = load(sky(type="image", file="sky.exr"))
    np.testing.assert_array_equal(scene.environment.radiance[0, :4, 0], np.float32([0, 1e30, 0, 1]))
    assert any("sky.exr: 2 values" in notice for notice in scene.notices)


def test_a_black_environment_is_none(load):
    assert load(sky(type="constant", radiance=[0, 0, 0])).environment is None
    assert load(lit(POINT)).environment is None


@pytest.mark.parametrize(("spec", "message"), [
    ({"type": "dome"}, "environment"), ({"radiance": [1, 1, 1]}, "type"),
    ({"type": "image", "file": "quad.mtl"}, "expected one of .exr, .hdr"), ({"type": "constant"}, "radiance"),
    ({"type": "image", "file": "\ud800.exr"}, "no such image file"),
    ({"type": "image", "file": ""}, r"file: an empty string \(expected a name"),
    ({"type": "constant", "radiance": [1, -1, 1]}, "radiance"), ({"type": "image", "file": "no.exr"}, r"no\.exr"),
    ({"type": "gradient", "zenith": [1, 1, 1], "horizon": [1, 1, 1]}, "ground"),
    ({"type": "constant", "radiance": [1, 1, 1], "file": "x"}, "file"),
])
def test_an_invalid_environment_gives_a_one_line_error(load, spec, message):
    with pytest.raises(SceneError, match=message) as error:
        load(sky(**spec))
    assert "\n" not in str(error.value)
