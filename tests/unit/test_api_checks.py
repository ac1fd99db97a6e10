"""What a program passes is refused in one line, or brought into plain form."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import app.api as afterglow
from app.api.checked import check_camera, check_cameras, check_environment, check_lights, check_material
from app.api.renderer import Renderer
from app.errors import AfterglowError
from app.scene import Clearcoat

NAN, INF = float("nan"), float("inf")
CAMERA = afterglow.Camera((0.0, 1.0, 4.0), (0.0, 0.0, 0.0))
POINT = afterglow.PointLight((0.0, 2.0, 0.0), (1.0, 1.0, 1.0))
SPOT = afterglow.SpotLight((0.0, 2.0, 0.0), (0.0, -2.0, 0.0), (1.0, 1.0, 1.0), 20.0, 30.0)
SUN = afterglow.DirectionalLight((0.0, -2.0, 0.0), (1.0, 1.0, 1.0))
RECT = afterglow.RectLight((0.0, 2.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0))
LENS = afterglow.Intrinsics(10.0, 10.0, 5.0, 5.0, 10.0, 10.0)
PIXELS = np.zeros((4, 4, 4), np.uint8)
POSE = np.eye(4)
K = [[100, 0, 50], [0, 100, 50], [0, 0, 1]]
TRIANGLE = np.eye(3), [[0, 1, 2]]
BOX = trimesh.creation.box()
TEXTURED = afterglow.Material(albedo_map=afterglow.Texture(PIXELS))


def light(**changes: object) -> object:
    return check_lights([replace(POINT, **changes)])


def material(**changes: object) -> object:
    return check_material(afterglow.Material(**changes), "box")


def environment(radiance: object) -> object:
    return check_environment(afterglow.Environment(radiance))


def camera(**changes: object) -> object:
    return check_camera(replace(CAMERA, **changes))


def renderer(scene: object = None, size: object = (4, 3), model: object = None, **options: object) -> Renderer:
    return Renderer(afterglow.load() if scene is None else scene, size, model, **options)


def add(mesh: object, *arguments: object, **options: object) -> object:
    return afterglow.Scene().add(mesh, *arguments, **options)


MISTAKES = [
    ("camera.eye", lambda: camera(eye=(NAN, 0, 0))),
    ("camera.eye", lambda: camera(eye=(INF, 0, 0))),
    ("camera.eye", lambda: camera(eye=(0, 0))),
    ("camera.eye", lambda: camera(eye="abc")),
    ("same point", lambda: camera(eye=(0, 0, 0))),
    ("camera.fov_y_deg", lambda: camera(fov_y_deg=0)),
    ("camera.fov_y_deg", lambda: camera(fov_y_deg=180)),
    ("camera.fov_y_deg", lambda: camera(fov_y_deg=NAN)),
    ("camera.fov_y_deg", lambda: camera(fov_y_deg="45")),
    ("camera.orthographic_height", lambda: camera(orthographic_height=-1)),
    ("camera.intrinsics.fx", lambda: camera(intrinsics=replace(LENS, fx=0))),
    ("camera.intrinsics", lambda: camera(intrinsics=np.eye(3))),
    ("cameras", lambda: check_cameras({"a": np.eye(4)})),
    ("cameras", lambda: check_cameras(None)),
    ("cameras", lambda: check_cameras({"a": afterglow.CameraPath((), ())})),
    ("camera: pose", lambda: afterglow.camera_from_matrix("pose")),
    ("camera: intrinsics", lambda: afterglow.camera_from_matrix(POSE, "K", (100, 100))),
    ("size", lambda: afterglow.camera_from_matrix(POSE, K, 100)),
    ("size", lambda: afterglow.camera_from_matrix(POSE, K, (0, 100))),
    ("camera.fov_y_deg", lambda: afterglow.camera_from_matrix(POSE, fov_y_deg="x")),
    ("convention", lambda: afterglow.camera_matrix(CAMERA, "blender")),
    ("convention", lambda: afterglow.camera_matrix(CAMERA, ["opencv"])),
    ("camera", lambda: afterglow.camera_matrix(None)),
    ("size", lambda: afterglow.intrinsic_matrix(CAMERA, "4x3")),
    ("size", lambda: afterglow.intrinsic_matrix(CAMERA, (4, 0))),
    ("lights", lambda: check_lights(POINT)),
    (r"lights\[1\]", lambda: check_lights([POINT, (0, 2, 0)])),
    (r"lights\[0\].position", lambda: light(position=(NAN, 0, 0))),
    (r"lights\[0\].intensity", lambda: light(intensity=5)),
    (r"lights\[0\].intensity", lambda: light(intensity=(-1, 1, 1))),
    (r"lights\[0\].intensity", lambda: light(intensity="bright")),
    (r"lights\[0\].radius", lambda: light(radius=-1)),
    ("length 0", lambda: check_lights([replace(SUN, direction=(0, 0, 0))])),
    ("outer_deg", lambda: check_lights([replace(SPOT, inner_deg=40)])),
    ("rectangle", lambda: check_lights([replace(RECT, edge_v=(1, 0, 0))])),
    ("two_sided", lambda: check_lights([replace(RECT, two_sided="yes")])),
    ("environment", lambda: check_environment(np.ones((4, 8, 3)))),
    ("environment.radiance", lambda: environment(np.ones((4, 8, 4)))),
    ("environment.radiance", lambda: environment(np.ones((4, 8)))),
    ("environment.radiance", lambda: environment(np.ones((0, 8, 3)))),
    ("environment.radiance", lambda: environment(np.full((4, 8, 3), NAN))),
    ("environment.radiance", lambda: environment(np.full((4, 8, 3), -1.0))),
    ("box: material", lambda: check_material("red", "box")),
    ("material.albedo", lambda: material(albedo=(255, 0, 0))),
    ("material.albedo", lambda: material(albedo=(0.5, 0.5, 0.5, 1))),
    ("material.albedo", lambda: material(albedo="red")),
    ("material.emission", lambda: material(emission=(NAN, 0, 0))),
    ("material.roughness", lambda: material(roughness=-3)),
    ("material.clearcoat.strength", lambda: material(clearcoat=Clearcoat(2.0, 0.1))),
    ("albedo_map", lambda: material(albedo_map=PIXELS)),
    ("albedo_map", lambda: material(albedo_map=afterglow.Texture(PIXELS, uv_set=1))),
    ("material.albedo_map.pixels", lambda: material(albedo_map=afterglow.Texture(PIXELS[..., :3]))),
    ("material.albedo_map.pixels", lambda: material(albedo_map=afterglow.Texture(PIXELS[:0]))),
    ("material.albedo_map.magnified", lambda: material(albedo_map=afterglow.Texture(PIXELS, magnified="cubic"))),
    ("material.emission_map", lambda: material(emission_map=PIXELS)),
    ("vertices", lambda: add(("abc", [[0, 1, 2]]))),
    ("vertices", lambda: add(([[0, 0, 0], [1, 1]], [[0, 1, 2]]))),
    ("vertices", lambda: add((np.eye(3) * 1j, [[0, 1, 2]]))),
    ("triangles", lambda: add((np.eye(3), [[0, 1], [2]]))),
    ("vertices: a value is not finite", lambda: add((np.diag([1, 1, NAN]), [[0, 1, 2]]))),
    ("normals: a value is not finite", lambda: add(TRIANGLE, normals=np.full((3, 3), NAN))),
    ("uvs: a value is not finite", lambda: add(TRIANGLE, uvs=np.full((3, 2), INF))),
    ("colors", lambda: add(TRIANGLE, colors="red")),
    ("colors", lambda: add(TRIANGLE, colors=np.full((3, 3), 255))),
    ("material", lambda: add(BOX, "red")),
    ("transform", lambda: add(BOX, transform="x")),
    ("name", lambda: add(BOX, name=5)),
    ("normals given", lambda: add(BOX, normals=np.zeros((8, 3)))),
    ("no uvs", lambda: add(BOX, TEXTURED)),
    ("no uvs", lambda: add(TRIANGLE, TEXTURED)),
    ("path", lambda: afterglow.load(5)),
    ("scene_json", lambda: afterglow.load(scene_json=5)),
    ("no lighting 5", lambda: afterglow.load(lighting=5)),
    ("no object 5", lambda: afterglow.Scene()[5]),
    ("path", lambda: afterglow.Scene(5)),
    ("path", lambda: afterglow.path_trace(afterglow.Scene())),
    ("size", lambda: afterglow.path_trace(size="8x8")),
    ("^size", lambda: afterglow.path_trace(size=(40000, 8))),
    ("^spp", lambda: afterglow.path_trace(size=(8, 8), spp=1.5)),
    ("can't draw", lambda: renderer(BOX)),
    ("size", lambda: renderer(size=48)),
    ("size", lambda: renderer(size=(48, 36, 3))),
    ("size", lambda: renderer(size=(48.0, 36.0))),
    ("size", lambda: renderer(size=(True, True))),
    ("model", lambda: renderer(model=5)),
    ("outputs", lambda: renderer(outputs="final")),
    ("exposure", lambda: renderer(exposure="bright")),
    ("tonemap", lambda: renderer(tonemap=None)),
    ("bounces", lambda: renderer(bounces="2")),
    ("seed", lambda: renderer(seed=1.5)),
    ("^scale", lambda: renderer(scale="1/8")),
    ("^render_scale", lambda: renderer(render_scale=0.3)),
    ("^size", lambda: renderer(size=(20000, 10))),
    ("^taa", lambda: renderer(taa="no")),
    ("^taa", lambda: renderer(taa=np.ones(3))),
    ("^exposure", lambda: renderer(exposure=np.ones(2))),
    ("^render_scale", lambda: renderer(render_scale=np.ones(2))),
    ("^bounces", lambda: renderer(bounces=np.array([1, 2]))),
    ("^seed", lambda: renderer(seed=True)),
    ("^outputs", lambda: renderer(outputs=(3,))),
    ("^outputs", lambda: renderer(outputs=("finl",)).render(CAMERA)),
    ("time", lambda: renderer().render(CAMERA, NAN)),
    ("time", lambda: renderer().render_batch([CAMERA], "now")),
    ("settle", lambda: renderer().render(CAMERA, settle=-1)),
    ("settle", lambda: renderer().render(CAMERA, settle=1.5)),
    ("2 times", lambda: list(renderer().render_video([CAMERA], [0, 1]))),
    ("cameras", lambda: list(renderer().render_video(CAMERA, [0, 1]))),
    ("lead_in", lambda: list(renderer().render_video([CAMERA], [0], lead_in=-1))),
    ("lead_in", lambda: list(renderer().render_video([CAMERA], [0], lead_in="x"))),
    ("video", lambda: afterglow.write_video(5, [])),
    ("null", lambda: afterglow.write_video("a\0.mp4", [])),
    ("^frames", lambda: afterglow.write_video("a.mp4", None)),
    ("frames", lambda: afterglow.write_video("a.mp4", [np.zeros((4, 4, 3), np.uint8)])),
    ("compare", lambda: afterglow.compare("a", "b")),
    ("compare: 8-bit", lambda: afterglow.compare(PIXELS[..., :3], PIXELS[..., :3])),
]


@pytest.mark.parametrize(("words", "mistake"), MISTAKES)
def test_a_mistake_is_one_line_that_names_its_place(words: str, mistake: Callable[[], object]) -> None:
    with pytest.raises(AfterglowError, match=words) as caught:
        mistake()
    assert "\n" not in str(caught.value) and "--" not in str(caught.value) and len(str(caught.value)) < 250


def test_arrays_and_integers_become_tuples_of_floats() -> None:
    given = afterglow.Camera(np.array([0, 1, 4]), [0, 0, 0], fov_y_deg=np.float32(45))
    assert check_camera(given) == CAMERA
    assert check_lights([replace(POINT, position=np.array(POINT.position), intensity=[1, 1, 1])]) == (POINT,)
    plain = check_material(afterglow.Material(albedo=np.array([0.5, 0.5, 0.5])), "box")
    assert plain.albedo == (0.5, 0.5, 0.5)


def test_directions_get_unit_length() -> None:
    assert [light.direction for light in check_lights([SPOT, SUN])] == [(0.0, -1.0, 0.0)] * 2


def test_images_become_bytes_or_float32() -> None:
    plain = check_material(afterglow.Material(albedo_map=afterglow.Texture(np.ones((2, 2, 4)))), "box")
    assert plain.albedo_map is not None and plain.albedo_map.pixels.dtype == np.float32
    plain = check_material(TEXTURED, "box")
    assert plain.albedo_map is not None and plain.albedo_map.pixels is PIXELS
    assert check_environment(afterglow.Environment([[[1, 1, 1]]])).radiance.dtype == np.float32


def test_albedo_of_unlit_materials_is_radiance() -> None:
    assert check_material(afterglow.Material(albedo=(5, 5, 5), is_unlit=True), "box").albedo == (5.0, 5.0, 5.0)


def test_transforms_are_read_only_so_that_a_change_in_place_is_not_lost() -> None:
    scene = afterglow.Scene()
    box = scene.add(BOX)
    with pytest.raises(ValueError, match="read-only"):
        box.transform[0, 3] = 1.0
    with pytest.raises(TypeError):
        del scene.objects["object"]


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda scene: pickle.loads(pickle.dumps(scene))])
def test_a_copy_of_a_scene_is_changed_on_its_own(duplicate: Callable[[afterglow.Scene], afterglow.Scene]) -> None:
    scene = afterglow.Scene()
    scene.add(BOX)
    other = duplicate(scene)
    other["object"].transform = np.diag([2.0, 2.0, 2.0, 1.0])
    other.add(BOX, name="second")
    assert list(scene.objects) == ["object"] and list(other.objects) == ["object", "second"]
    assert np.array_equal(scene["object"].transform, np.eye(4))
    with pytest.raises(ValueError, match="read-only"):
        other["second"].transform[0, 3] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        duplicate(scene)["object"].transform[0, 3] = 1.0
