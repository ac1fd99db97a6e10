"""Animations, skins and morph targets of glTF files."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from app.errors import SceneError
from app.evaluation.hashing import content_key
from app.load import gltf_deformation, load_scene, scene_builder
from app.math3d import View, translation
from app.scene import Scene
from export.dataset.scene_key import scene_key
from tests.unit.load_helpers import TRIANGLE, Gltf

HALF = np.sqrt(0.5)
LIFTED = TRIANGLE + np.array([0, 0, 1])
IDENTITY, QUARTER = [0, 0, 0, 1], [0, 0, HALF, HALF]  # a quarter about z: x becomes y


def animate(gltf: Gltf, node: int, path: str, values: list, times: tuple[float, ...] = (0, 1),
            interpolation: str = "LINEAR", name: str | None = None) -> None:
    """Add an animation of one channel."""
    animation = {
        "samplers": [{"input": gltf.array(np.array(times, np.float32)), "interpolation": interpolation,
                      "output": gltf.array(np.array(values, np.float32))}],
        "channels": [{"sampler": 0, "target": {"node": node, "path": path}}]}
    gltf.json.setdefault("animations", []).append(animation | ({"name": name} if name else {}))


def add_nodes(gltf: Gltf, *nodes: dict) -> None:
    """Add roots beside the mesh's, and a camera that they may name."""
    gltf.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.5}}]
    gltf.json["nodes"] += nodes
    gltf.json["scenes"][0]["nodes"] = list(range(len(gltf.json["nodes"])))


def corners(scene: Scene, time: float, index: int = 0) -> np.ndarray:
    """World-space vertices of an instance, [V, 3]."""
    instance = scene.instances[index]
    transform = instance.transform_at(time)
    return instance.mesh_at(scene.meshes, time).positions @ transform[:3, :3].T + transform[:3, 3]


def spinning() -> Gltf:
    gltf = Gltf()
    gltf.json["nodes"] = [{"mesh": 0, "name": "thing", "translation": [2, 0, 0]}, {"children": [0], "scale": [2, 2, 2]}]
    gltf.json["scenes"][0]["nodes"] = [1]
    animate(gltf, 1, "rotation", [IDENTITY, QUARTER], name="spin")
    animate(gltf, 1, "translation", [[0, 0, 0], [0, 0, 3]], (0, 2), name="slide")
    return gltf


def test_meshes_follow_animated_ancestors(tmp_path: Path) -> None:
    scene = load_scene(spinning().save(tmp_path))
    np.testing.assert_allclose(corners(scene, 0), [[4, 0, 0], [6, 0, 0], [4, 2, 0]], atol=1e-6)
    s = 4 * HALF
    np.testing.assert_allclose(corners(scene, 0.5)[0], [s, s, 0], atol=1e-6)
    np.testing.assert_allclose(corners(scene, 1 - 1e-12), [[0, 4, 0], [0, 6, 0], [-2, 4, 0]], atol=1e-6)
    np.testing.assert_allclose(corners(scene, 1.5), corners(scene, 0.5))  # it repeats
    np.testing.assert_allclose(scene.bounds, [[4, 0, 0], [6, 2, 0]], atol=1e-6)
    np.testing.assert_allclose(scene.swept_bounds, [[-2, 0, 0], [6, 6, 0]], atol=0.5)  # around rotated boxes


@pytest.mark.parametrize(("name", "expected"), [
    (None, [0, 4, 0]), ("spin", [0, 4, 0]), ("slide", [4, 0, 1.5]), ("all", [0, 4, 1.5]), ("none", [4, 0, 0])])
def test_the_animation_is_chosen_by_its_name(tmp_path: Path, name: str | None, expected: list[float]) -> None:
    scene = load_scene(spinning().save(tmp_path), animation=name)
    np.testing.assert_allclose(corners(scene, 1 - 1e-12)[0], expected, atol=1e-6)
    assert scene.instances[0].moves == (name != "none")


def test_an_unknown_animation_is_refused_with_the_names(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"no animation 'spun'.*spin.*slide"):
        load_scene(spinning().save(tmp_path), animation="spun")


@pytest.mark.parametrize("kind", ["gltf", "obj"])
def test_a_file_without_animation_refuses_a_name(tmp_path: Path, kind: str) -> None:
    if kind == "obj":
        path = tmp_path / "scene.obj"
        path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    else:
        path = Gltf().save(tmp_path)
    with pytest.raises(SceneError, match="has no animation"):
        load_scene(path, animation="walk")


@pytest.mark.parametrize(("interpolation", "values", "expected"), [
    ("STEP", [[1, 0, 0], [3, 0, 0]], 1.0),
    ("LINEAR", [[1, 0, 0], [3, 0, 0]], 1.5),
    # Hermite at a quarter of 2 s: 1·0.84375 + 2·1·0.140625 + 3·0.15625 - 2·4·0.046875
    ("CUBICSPLINE", [[0, 0, 0], [1, 0, 0], [1, 0, 0], [4, 0, 0], [3, 0, 0], [0, 0, 0]], 1.21875),
])
def test_interpolation(tmp_path: Path, interpolation: str, values: list, expected: float) -> None:
    gltf = Gltf()
    animate(gltf, 0, "translation", values, (1, 3), interpolation)
    scene = load_scene(gltf.save(tmp_path))
    assert corners(scene, 1.5)[0, 0] == pytest.approx(expected)
    assert corners(scene, 0.0)[0, 0] == pytest.approx(1)


def test_a_track_that_never_changes_makes_nothing_move(tmp_path: Path) -> None:
    gltf = Gltf()
    animate(gltf, 0, "translation", [[5, 0, 0], [5, 0, 0]])
    (instance,) = (scene := load_scene(gltf.save(tmp_path))).instances
    assert not instance.moves
    np.testing.assert_allclose(corners(scene, 0)[0], [5, 0, 0])


def test_quantised_rotations(tmp_path: Path) -> None:
    gltf = Gltf()
    animate(gltf, 0, "rotation", [IDENTITY, QUARTER])
    keys = np.round(np.array([IDENTITY, QUARTER]) * 32767).astype(np.int16)
    gltf.json["animations"][0]["samplers"][0]["output"] = gltf.array(keys, normalized=True)
    scene = load_scene(gltf.save(tmp_path))
    np.testing.assert_allclose(corners(scene, 0.5)[1], [HALF, HALF, 0], atol=1e-4)


def test_a_camera_follows_its_node(tmp_path: Path) -> None:
    gltf = Gltf()
    add_nodes(gltf, {"camera": 0, "name": "eye"})
    animate(gltf, 1, "translation", [[0, 0, 3], [1, 0, 3]])
    camera = load_scene(gltf.save(tmp_path)).cameras["eye"]
    for time in (0.0, 0.5, 0.9, 1.5):
        np.testing.assert_allclose(camera.at(time).eye, [time % 1, 0, 3], atol=1e-9)
        np.testing.assert_allclose(camera.at(time).target, [time % 1, 0, 2], atol=1e-9)


def test_a_camera_jumps_and_loops_with_its_own_animation(tmp_path: Path) -> None:
    """By steps, at a time that no rate of frames meets; another animation is longer."""
    gltf = Gltf()
    add_nodes(gltf, {"camera": 0, "name": "eye"}, {})
    animate(gltf, 1, "translation", [[0, 0, 3], [100, 0, 3], [100, 0, 3]], (0, 1 / 3, 0.7), "STEP")
    animate(gltf, 2, "translation", [[0, 0, 0], [1, 0, 0]])
    camera = load_scene(gltf.save(tmp_path), animation="all").cameras["eye"]
    assert [camera.at(t).eye[0] for t in (0.0, 0.333, 0.334, 0.69, 0.71, 1.1)] == [0, 0, 100, 100, 0, 100]


def test_cameras_of_one_name_are_all_kept(tmp_path: Path) -> None:
    gltf = Gltf()
    add_nodes(gltf, *({"camera": 0, "name": "eye", "translation": [x, 0, 3]} for x in (1, 2, 3)))
    cameras = load_scene(gltf.save(tmp_path)).cameras
    assert {name: camera.at(0).eye[0] for name, camera in cameras.items()} == {"eye": 1, "eye 2": 2, "eye 3": 3}


def test_a_camera_of_a_unique_name_keeps_it(tmp_path: Path) -> None:
    gltf = Gltf()
    add_nodes(gltf, *({"camera": 0, "name": name} for name in ("eye", "eye", "eye 2")))
    assert list(load_scene(gltf.save(tmp_path)).cameras) == ["eye", "eye 3", "eye 2"]


def test_a_camera_rolls_with_its_node(tmp_path: Path) -> None:
    gltf = Gltf()
    add_nodes(gltf, {"camera": 0, "name": "eye", "translation": [0, 0, 3]})
    animate(gltf, 1, "rotation", [IDENTITY, QUARTER])
    camera = load_scene(gltf.save(tmp_path)).cameras["eye"].at(1 - 1e-12)
    np.testing.assert_allclose([camera.target, camera.up], [[0, 0, 2], [-1, 0, 0]], atol=1e-6)


@pytest.mark.parametrize("is_animated", [False, True])
@pytest.mark.parametrize("x", [1e18, 1e200, math.nan])
def test_a_camera_out_of_reach_is_ignored(tmp_path: Path, x: float, is_animated: bool) -> None:
    """Another camera of the file can still be drawn from."""
    gltf = Gltf()
    add_nodes(gltf, {"camera": 0, "name": "lost", "translation": [x, 0, 0]}, {"camera": 0, "name": "eye"})
    if is_animated:
        animate(gltf, 1, "scale", [[1, 1, 1], [2, 2, 2]])
    scene = load_scene(gltf.save(tmp_path))
    assert list(scene.cameras) == ["eye"]
    assert any("'lost' has a coordinate that is no number, or beyond 1e+15" in notice for notice in scene.notices)


def test_a_camera_of_a_matrix_without_a_direction_keeps_its_own(tmp_path: Path) -> None:
    gltf = Gltf()
    add_nodes(gltf, {"camera": 0, "name": "eye", "matrix": [1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1]})
    assert load_scene(gltf.save(tmp_path)).cameras["eye"].at(0.0).target == (0, 0, -1)


@pytest.mark.parametrize("axis", [1, 2])
def test_what_has_no_length_along_one_axis_keeps_its_direction(tmp_path: Path, axis: int) -> None:
    """Turned from -z to +y, flat across or along the view."""
    gltf = Gltf()
    gltf.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "directional"}]}}
    flat = {"rotation": [math.sqrt(0.5), 0, 0, math.sqrt(0.5)], "scale": [0.0 if i == axis else 2.0 for i in range(3)]}
    add_nodes(gltf, {"camera": 0, "name": "eye", **flat},
              {"extensions": {"KHR_lights_punctual": {"light": 0}}, **flat})
    scene = load_scene(gltf.save(tmp_path))
    camera = scene.cameras["eye"].at(0.0)
    np.testing.assert_allclose([camera.target, camera.up], [[0, 1, 0], [0, 0, 1]], atol=1e-6)
    np.testing.assert_allclose(scene.lights[0].direction, [0, 1, 0], atol=1e-6)


@pytest.mark.parametrize(("scale", "is_animated"), [(0.0, False), (0.0, True), (1e-200, False)])
def test_a_light_and_a_camera_at_a_node_of_scale_0_are_no_error(tmp_path: Path, scale: float,
                                                                is_animated: bool) -> None:
    """A way to hide what is below a node."""
    gltf = Gltf()
    gltf.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}, {"type": "spot"}]}}
    hidden = {"scale": [scale] * 3, "translation": [0, 0, 2]}
    add_nodes(gltf, {"camera": 0, "name": "eye", **hidden},
              *({"extensions": {"KHR_lights_punctual": {"light": k}}, **hidden} for k in (0, 1)))
    if is_animated:
        animate(gltf, 1, "scale", [[0, 0, 0], [1, 1, 1]], (0, 1), "STEP")
    scene = load_scene(gltf.save(tmp_path))
    assert scene.cameras["eye"].at(0.5).target == (0, 0, 1)
    assert [light.position for light in scene.lights] == [(0, 0, 2)] * (1 if scale == 0 else 2)
    assert any("scale 0" in notice for notice in scene.notices) == (scale == 0)


@pytest.mark.parametrize("times", [(0,), (-1, 0), (-2, -1)])
def test_an_animation_that_ends_at_time_0_stands_still(tmp_path: Path, times: tuple[float, ...]) -> None:
    gltf = Gltf()
    add_nodes(gltf, {"camera": 0, "name": "eye"})
    animate(gltf, 1, "translation", [[0, 0, 3], [1, 0, 3]][-len(times):], times)
    scene = load_scene(gltf.save(tmp_path))
    for time in (0.0, 1.5):
        np.testing.assert_allclose(scene.cameras["eye"].at(time).eye, [1, 0, 3])
    assert ("the animation has no key after 0 s, so it stands still" in scene.notices) == (len(times) > 1)


def test_one_key_of_weights_at_time_0_gives_no_notice(tmp_path: Path) -> None:
    gltf = morphing()
    animate(gltf, 0, "weights", [0.5, 0.5], (0,))
    assert not any("stands still" in notice for notice in load_scene(gltf.save(tmp_path)).notices)


def test_lengths_of_a_scene_that_begins_as_a_point_are_those_of_its_animation(tmp_path: Path) -> None:
    gltf = Gltf()
    animate(gltf, 0, "scale", [[0, 0, 0], [100, 100, 100]])
    scene = load_scene(gltf.save(tmp_path))
    largest = float(np.ptp(scene.swept_bounds, axis=0).max())
    assert largest > 80 and scene.longest_edge == pytest.approx(largest / 100)
    assert scene.with_lights().swept_bounds is scene.swept_bounds


def test_animated_lights_and_pointers_give_notices(tmp_path: Path) -> None:
    gltf = spinning()
    gltf.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    gltf.json["nodes"][1]["extensions"] = {"KHR_lights_punctual": {"light": 0}}
    pointer = {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": "/materials/0/alphaCutoff"}}}
    gltf.json["animations"][0]["channels"].append({"sampler": 0, "target": pointer})
    notices = load_scene(gltf.save(tmp_path)).notices
    assert any("lights of animated nodes" in n for n in notices)
    assert any("KHR_animation_pointer" in n for n in notices)


def arm(weights: np.ndarray | None = None) -> Gltf:
    """The triangle on two joints: the lower one stands still, the upper one, at x = 1, turns about z."""
    gltf = Gltf()
    gltf.json["nodes"] = [
        {"mesh": 0, "skin": 0, "name": "arm", "translation": [7, 7, 7]},  # which a skinned mesh ignores
        {"children": [2], "translation": [0, 0, 1]}, {"translation": [1, 0, 0]}]
    gltf.json["scenes"][0]["nodes"] = [0, 1]
    binds = np.stack([np.eye(4), translation(np.array([-1.0, 0, 0]))]).transpose(0, 2, 1).reshape(2, 16)
    gltf.json["skins"] = [{"joints": [1, 2], "inverseBindMatrices": gltf.array(binds.astype(np.float32), type="MAT4")}]
    shares = np.array([[1, 0, 0, 0], [0.25, 0.75, 0, 0], [0, 1, 0, 0]], np.float32) if weights is None else weights
    gltf.primitive["attributes"] |= {"JOINTS_0": gltf.array(np.tile(np.array([0, 1, 0, 0], np.uint8), (3, 1))),
                                     "WEIGHTS_0": gltf.array(shares)}
    animate(gltf, 2, "rotation", [IDENTITY, QUARTER])
    return gltf


def skinned(shares: np.ndarray) -> np.ndarray:
    """The triangle of ``arm`` at 1 s, by hand: the lower joint adds (0, 0, 1), the upper one also turns about x = 1."""
    lower, offset = LIFTED, TRIANGLE - np.array([1, 0, 0])
    upper = np.stack([1 - offset[:, 1], offset[:, 0], offset[:, 2] + 1], axis=1)
    return shares[:, :1] * lower + shares[:, 1:2] * upper


def test_a_skin_moves_vertices_by_the_matrices_of_its_joints(tmp_path: Path) -> None:
    scene = load_scene(arm().save(tmp_path))
    assert scene.instances[0].deformation is not None
    shares = np.array([[1, 0], [0.25, 0.75], [0, 1]])
    np.testing.assert_allclose(corners(scene, 0), LIFTED, atol=1e-6)
    np.testing.assert_allclose(corners(scene, 1 - 1e-12), skinned(shares), atol=1e-6)
    np.testing.assert_allclose(scene.bounds, [[0, 0, 1], [1, 1, 1]], atol=1e-6)


def test_weights_are_scaled_to_a_sum_of_one(tmp_path: Path) -> None:
    broken = np.array([[4, 0, 0, 0], [0.5, 1.5, 0, 0], [-1, np.nan, 0, 0]], np.float32)
    scene = load_scene(arm(broken).save(tmp_path))
    assert any("do not add up to 1" in n for n in scene.notices)
    shares = np.array([[1, 0], [0.25, 0.75], [1, 0]])  # without any weight, the first joint
    np.testing.assert_allclose(corners(scene, 1 - 1e-12), skinned(shares), atol=1e-6)


def test_a_skin_whose_joints_rest_is_an_ordinary_mesh_in_its_pose(tmp_path: Path) -> None:
    gltf = arm()
    del gltf.json["animations"]
    gltf.json["nodes"][2]["rotation"] = QUARTER
    (instance,) = (scene := load_scene(gltf.save(tmp_path))).instances
    assert not instance.moves
    np.testing.assert_allclose(corners(scene, 0), skinned(np.array([[1, 0], [0.25, 0.75], [0, 1]])), atol=1e-6)


def morphing(sparse: bool = False) -> Gltf:
    """The triangle with two targets: its first corner moves along x, its last along z."""
    gltf = Gltf()
    targets = np.zeros((2, 3, 3), np.float32)
    targets[0, 0, 0], targets[1, 2, 2] = -2, 3
    if sparse:
        accessors = [gltf.array(np.zeros((3, 3), np.float32)) for _ in targets]
        for target, accessor, row in zip(targets, accessors, (0, 2), strict=True):
            spec = gltf.json["accessors"][accessor]
            del spec["bufferView"]
            spec["sparse"] = {"count": 1, "indices": {"bufferView": gltf.view(np.array([row], np.uint16).tobytes()),
                                                      "componentType": 5123},
                              "values": {"bufferView": gltf.view(target[row].tobytes())}}
    else:
        accessors = [gltf.array(target) for target in targets]
    gltf.primitive["targets"] = [{"POSITION": accessor} for accessor in accessors]
    gltf.json["meshes"][0]["weights"] = [0.5, 0]
    return gltf


@pytest.mark.parametrize("sparse", [False, True])
def test_morph_targets_add_to_vertices(tmp_path: Path, sparse: bool) -> None:
    gltf = morphing(sparse)
    (instance,) = (scene := load_scene(gltf.save(tmp_path))).instances
    assert not instance.moves
    np.testing.assert_allclose(corners(scene, 0), [[-1, 0, 0], [1, 0, 0], [0, 1, 0]], atol=1e-6)
    gltf.json["nodes"][0]["weights"] = [0, 1]
    scene = load_scene(gltf.save(tmp_path))
    np.testing.assert_allclose(corners(scene, 0), [[0, 0, 0], [1, 0, 0], [0, 1, 3]], atol=1e-6)


def test_animated_weights(tmp_path: Path) -> None:
    gltf = morphing()
    animate(gltf, 0, "weights", [0, 0, 1, -1], (0, 2))
    scene = load_scene(gltf.save(tmp_path))
    np.testing.assert_allclose(corners(scene, 0), TRIANGLE, atol=1e-6)
    np.testing.assert_allclose(corners(scene, 1.0), [[-1, 0, 0], [1, 0, 0], [0, 1, -1.5]], atol=1e-6)


def test_two_nodes_morph_one_mesh_by_their_own_weights(tmp_path: Path) -> None:
    gltf = morphing()
    gltf.json["nodes"].append({"mesh": 0, "weights": [1, 0], "translation": [0, 9, 0]})
    gltf.json["scenes"][0]["nodes"] = [0, 1]
    animate(gltf, 0, "weights", [0, 0, 1, -1], (0, 2))
    scene = load_scene(gltf.save(tmp_path))
    np.testing.assert_allclose(corners(scene, 1.0, 1), [[-2, 9, 0], [1, 9, 0], [0, 10, 0]], atol=1e-6)


def test_a_triangle_that_gains_an_area_is_kept(tmp_path: Path) -> None:
    gltf = morphing()
    gltf.json["accessors"][0] = gltf.json["accessors"][gltf.array(np.zeros((3, 3), np.float32))]
    animate(gltf, 0, "weights", [0, 0, 1, -1], (0, 2))
    assert load_scene(gltf.save(tmp_path)).triangles == 1


def test_unused_vertices_keep_the_others_on_their_joints(tmp_path: Path) -> None:
    gltf = arm()
    gltf.primitive["indices"] = gltf.array(np.array([2, 1, 3], np.uint16))
    gltf.json["accessors"][0] = gltf.json["accessors"][gltf.array(np.insert(TRIANGLE, 0, 9, axis=0))]
    shares = np.array([[0, 1], [1, 0], [0.25, 0.75], [0, 1]])
    gltf.primitive["attributes"] |= {
        "JOINTS_0": gltf.array(np.tile(np.array([0, 1, 0, 0], np.uint8), (4, 1))),
        "WEIGHTS_0": gltf.array(np.pad(shares, ((0, 0), (0, 2))).astype(np.float32))}
    scene = load_scene(gltf.save(tmp_path))
    np.testing.assert_allclose(corners(scene, 1 - 1e-12), skinned(shares[1:]), atol=1e-6)


def _nan_key(gltf: Gltf) -> None:
    animate(gltf, 0, "translation", [[0, 0, 0], [np.nan, 0, 0]])


def _disordered(gltf: Gltf) -> None:
    animate(gltf, 0, "translation", [[0, 0, 0], [1, 0, 0]], (1, 0))


def _too_few_values(gltf: Gltf) -> None:
    animate(gltf, 0, "translation", [[0, 0, 0]])


def _missing_node(gltf: Gltf) -> None:
    animate(gltf, -1, "translation", [[0, 0, 0], [1, 0, 0]])


def _unknown_path(gltf: Gltf) -> None:
    animate(gltf, 0, "colour", [[0, 0, 0], [1, 0, 0]])


def _unknown_interpolation(gltf: Gltf) -> None:
    animate(gltf, 0, "translation", [[0, 0, 0], [1, 0, 0]], interpolation="QUINTIC")


def _explodes(gltf: Gltf) -> None:
    """Only after some time, and beyond what numbers can hold."""
    for node in range(30):
        gltf.json["nodes"].append({"children": [node]})
        animate(gltf, node, "scale", [[1, 1, 1], [1e14] * 3])
    first, *others = gltf.json["animations"]
    for other in others:
        first["channels"].append(other["channels"][0] | {"sampler": 0})
    gltf.json["scenes"][0]["nodes"] = [30]


def _cyclic_joints(gltf: Gltf) -> None:
    gltf.json["nodes"] += [{"children": [2]}, {"children": [1]}]
    gltf.json["nodes"][0]["skin"] = 0
    gltf.json["skins"] = [{"joints": [1]}]


def _no_joints(gltf: Gltf) -> None:
    gltf.json.update(arm().json)
    gltf.json["skins"][0]["joints"] = []


def _missing_joint(gltf: Gltf) -> None:
    gltf.json.update(arm().json)
    gltf.json["skins"][0]["joints"] = [1, 99]


def _joint_beyond(gltf: Gltf) -> None:
    gltf.json.update(arm().json)
    gltf.json["skins"][0]["joints"] = [1]


def _short_binds(gltf: Gltf) -> None:
    gltf.json.update(arm().json)
    gltf.json["skins"][0]["joints"] = [1, 2, 0]


def _bomb(gltf: Gltf) -> None:
    gltf.json["accessors"].append({"componentType": 5126, "count": 2**22, "type": "VEC3"})
    zeros = len(gltf.json["accessors"]) - 1
    gltf.primitive.update(attributes={"POSITION": zeros}, targets=[{"POSITION": zeros}] * 1000)


def _short_target(gltf: Gltf) -> None:
    gltf.primitive["targets"] = [{"POSITION": gltf.array(np.zeros((2, 3), np.float32))}]


def _wrong_weight_count(gltf: Gltf) -> None:
    gltf.json.update(morphing().json)
    animate(gltf, 0, "weights", [0, 1])


@pytest.mark.parametrize("damage", [
    _nan_key, _disordered, _too_few_values, _missing_node, _unknown_path, _unknown_interpolation, _explodes,
    _cyclic_joints, _no_joints, _missing_joint, _joint_beyond, _short_binds, _bomb, _short_target, _wrong_weight_count])
def test_damaged_animations_skins_and_targets_are_scene_errors(tmp_path: Path,
                                                               damage: Callable[[Gltf], None]) -> None:
    gltf = Gltf()
    damage(gltf)
    with pytest.raises(SceneError) as caught:
        load_scene(gltf.save(tmp_path))
    assert "\n" not in str(caught.value) and str(tmp_path) in str(caught.value)


def test_a_joint_may_carry_a_skin_itself(tmp_path: Path) -> None:
    """Also one that is its own joint, since a skinned mesh ignores its node's transform."""
    gltf = arm()
    gltf.json["skins"][0]["joints"] = [0, 2]
    scene = load_scene(gltf.save(tmp_path))
    np.testing.assert_allclose(corners(scene, 0)[0], [7, 7, 7], atol=1e-6)


def test_the_automatic_camera_keeps_all_motion_in_the_picture(tmp_path: Path) -> None:
    scene = load_scene(spinning().save(tmp_path))
    view = View.of(scene.cameras[scene.default_camera].at(0.0), (64, 48), 0.1)
    for time in np.linspace(0, 0.999, 8):
        points = np.c_[corners(scene, time) - view.eye, np.ones(3)] @ view.clip_from_relative().T
        assert (np.abs(points[:, :2]) <= points[:, 3:]).all()


@pytest.mark.parametrize("make", [spinning, arm, morphing])
def test_references_of_animated_scenes_have_keys(tmp_path: Path, make: Callable[[], Gltf]) -> None:
    """Which depend on the animation, and survive a journey to another process."""
    gltf = make()
    if make is morphing:
        animate(gltf, 0, "weights", [0, 0, 1, -1], (0, 2))
    scene, again, rest = (load_scene(gltf.save(tmp_path), animation=name) for name in (None, None, "none"))
    again.instances[0].mesh_at(again.meshes, 0.3)
    key = content_key(scene)
    assert key == content_key(again) == content_key(pickle.loads(pickle.dumps(again)))
    assert key != content_key(rest)
    assert scene_key(scene) == scene_key(again) != scene_key(rest)


@pytest.mark.parametrize("given", [False, True])
def test_tangents_of_normal_maps_follow(tmp_path: Path, given: bool) -> None:
    """Also where they are made from uvs, for which vertices may be split."""
    gltf = arm(np.tile(np.array([0, 1, 0, 0], np.float32), (3, 1)))
    gltf.primitive["attributes"] |= {"TEXCOORD_0": gltf.array(TRIANGLE[:, :2]),
                                     "NORMAL": gltf.array(np.tile(np.array([0, 0, 1], np.float32), (3, 1)))}
    if given:
        gltf.primitive["attributes"]["TANGENT"] = gltf.array(np.tile(np.array([1, 0, 0, -1], np.float32), (3, 1)))
    gltf.material(normalTexture={"index": gltf.texture(np.full((2, 2, 3), 128))})
    scene = load_scene(gltf.save(tmp_path))
    for time, direction in ((0.0, [1, 0, 0]), (1 - 1e-12, [0, 1, 0])):
        mesh = scene.instances[0].mesh_at(scene.meshes, time)
        np.testing.assert_allclose(mesh.tangents[:, :3], [direction] * len(mesh.tangents), atol=1e-6)
        np.testing.assert_allclose(mesh.normals, [[0, 0, 1]] * len(mesh.tangents), atol=1e-6)
    assert (np.sign(mesh.tangents[:, 3]) == np.sign(scene.meshes[0].tangents[:, 3])).all()
    del gltf.json["animations"]
    gltf.json["nodes"][2]["rotation"] = QUARTER
    (still,) = load_scene(gltf.save(tmp_path)).meshes
    np.testing.assert_allclose(still.tangents[:, :3], [[0, 1, 0]] * len(still.tangents), atol=1e-6)


@pytest.mark.parametrize("is_animated", [False, True])
def test_a_skin_that_mirrors_faces_outwards(tmp_path: Path, is_animated: bool) -> None:
    """As the same mesh without a skin below the mirrored node: front, normals and bitangents."""
    def build(is_skinned: bool) -> Scene:
        gltf = Gltf()
        uvs = np.array([[0, 0], [1, 0], [0, 1]], np.float32)
        texture = gltf.texture(np.full((2, 2, 3), 128))
        gltf.json["materials"] = [{"normalTexture": {"index": texture}}]
        gltf.primitive["material"] = 0
        gltf.primitive["attributes"] |= {
            "NORMAL": gltf.array(np.tile(np.array([0, 0, 1], np.float32), (3, 1))), "TEXCOORD_0": gltf.array(uvs)}
        gltf.json["nodes"] = [{"mesh": 0, "name": "body"}, {"name": "joint"},
                              {"scale": [-1, 1, 1], "children": [0, 1]}]
        gltf.json["scenes"][0]["nodes"] = [2]
        if is_skinned:
            gltf.json["nodes"][0]["skin"] = 0
            gltf.json["skins"] = [{"joints": [1]}]
            gltf.primitive["attributes"] |= {"JOINTS_0": gltf.array(np.zeros((3, 4), np.uint8)),
                                             "WEIGHTS_0": gltf.array(np.eye(4, dtype=np.float32)[[0, 0, 0]])}
        if is_animated:
            animate(gltf, 1 if is_skinned else 0, "translation", [[0, 0, 0], [0, 0, 1]])
        return load_scene(gltf.save(tmp_path, f"{is_skinned}.gltf"))

    def frame(scene: Scene) -> tuple[np.ndarray, ...]:
        """Corners in the order in which the front is seen, normals, tangents, bitangents: in world space."""
        (instance,) = scene.instances
        mesh, matrix = instance.mesh_at(scene.meshes, 0.5), instance.transform_at(0.5)
        sign = np.sign(np.linalg.det(matrix[:3, :3]))
        corners = mesh.positions[mesh.triangles[0]] @ matrix[:3, :3].T + matrix[:3, 3]
        assert mesh.tangents is not None
        normals = mesh.normals @ np.linalg.inv(matrix[:3, :3])
        tangents = mesh.tangents[:, :3] @ matrix[:3, :3].T
        bitangents = np.cross(normals, tangents) * mesh.tangents[:, 3:] * sign
        return sign * np.cross(corners[1] - corners[0], corners[2] - corners[0]), normals, tangents, bitangents

    for found, expected in zip(frame(build(True)), frame(build(False)), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-6)


def test_each_triangle_of_a_skin_faces_outwards_by_its_own_joints(tmp_path: Path) -> None:
    """Two primitives of one vertex buffer: one follows a joint that mirrors it, and so does half of the other."""
    gltf = Gltf()
    gltf.json["nodes"] += [{}, {"scale": [-1, 1, 1]}]
    gltf.json["scenes"][0]["nodes"] = [0, 1, 2]
    gltf.json["nodes"][0]["skin"] = 0
    gltf.json["skins"] = [{"joints": [1, 2]}]
    joints = np.zeros((12, 4), np.uint8)
    joints[3:, 0] = 1
    shared = {"POSITION": gltf.array(np.tile(TRIANGLE, (4, 1))), "JOINTS_0": gltf.array(joints),
              "NORMAL": gltf.array(np.tile(np.array([0, 0, 1], np.float32), (12, 1))),
              "WEIGHTS_0": gltf.array(np.eye(4, dtype=np.float32)[[0] * 12])}
    gltf.json["meshes"][0]["primitives"] = [
        {"attributes": shared, "indices": gltf.array(np.arange(*part, dtype=np.uint8))} for part in ((0, 6), (6, 12))]
    scene = load_scene(gltf.save(tmp_path))
    assert [len(mesh.triangles) for mesh in scene.meshes] == [2, 2]
    for mesh in scene.meshes:
        a, b, c = mesh.positions[mesh.triangles].transpose(1, 0, 2)
        np.testing.assert_allclose(np.cross(b - a, c - a), [[0, 0, 1]] * 2, atol=1e-6)
        np.testing.assert_allclose(mesh.normals, [[0, 0, 1]] * 6, atol=1e-6)


@pytest.mark.parametrize(("attribute", "is_noticed"), [("COLOR_0", True), ("TEXCOORD_1", True), ("_OWN", False)])
def test_what_morph_targets_lack_is_noticed(tmp_path: Path, attribute: str, is_noticed: bool) -> None:
    gltf = morphing()
    for target in gltf.primitive["targets"]:
        target[attribute] = target["POSITION"]
    notices = load_scene(gltf.save(tmp_path)).notices
    assert any("morph targets of colours" in notice for notice in notices) == is_noticed


def test_vertices_that_primitives_share_count_where_they_are_used(tmp_path: Path,
                                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gltf_deformation, "_MAX_VERTICES", 100)
    monkeypatch.setattr(scene_builder, "MAX_VERTICES", 100)
    gltf = Gltf()
    positions = gltf.array(np.random.default_rng(0).random((90, 3)).astype(np.float32))
    target = gltf.array(np.zeros((90, 3), np.float32))
    gltf.json["meshes"][0]["primitives"] = [
        {"attributes": {"POSITION": positions}, "indices": gltf.array(np.arange(3 * k, 3 * k + 3, dtype=np.uint8)),
         "targets": [{"POSITION": target}]} for k in range(10)]
    scene = load_scene(gltf.save(tmp_path))
    assert sum(len(mesh.positions) for mesh in scene.meshes) == 30
    monkeypatch.setattr(gltf_deformation, "_MAX_VERTICES", 50)
    with pytest.raises(SceneError, match=r"too many vertices.*at most 50"):
        load_scene(gltf.save(tmp_path))
