"""glTF and GLB files."""

from __future__ import annotations

import json

import numpy as np
import pytest

from app.errors import SceneError
from app.load import load_scene
from app.scene import DirectionalLight, PointLight, SpotLight
from tests.unit.load_helpers import TRIANGLE, Gltf, world


def load(gltf, folder):
    return load_scene(gltf.save(folder))


def test_nested_transforms_and_mirroring(tmp_path):
    gltf = Gltf()
    gltf.json["nodes"] = [{"children": [1], "translation": [10, 0, 0], "rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)]},
                          {"mesh": 0, "scale": [-2, 1, 1], "name": "mirrored"}]
    scene = load(gltf, tmp_path)
    (instance,) = scene.instances
    assert instance.name == "mirrored"
    assert np.linalg.det(instance.transform[:3, :3]) < 0
    np.testing.assert_allclose(world(scene, instance)[0], [[10, 0, 0], [10, -2, 0], [9, 0, 0]], atol=1e-6)


@pytest.mark.parametrize(("values", "more"), [
    (np.array([[1, 0, 0.5]] * 3, np.float32), {}),
    (np.array([[65535, 0, 32768, 65535]] * 3, np.uint16), {"normalized": True}),
    (np.array([[255, 0, 128]] * 3, np.uint8), {"normalized": True}),
])
def test_vertex_colours_are_linear_rgba(tmp_path, values, more):
    gltf = Gltf()
    gltf.primitive["attributes"]["COLOR_0"] = gltf.array(values, **more)
    np.testing.assert_allclose(load(gltf, tmp_path).meshes[0].colors, [[1, 0, 0.5, 1]] * 3, atol=0.003)


@pytest.mark.parametrize(("name", "values"), [
    ("COLOR_0", np.full((3, 2), 0.5, np.float32)), ("NORMAL", np.full((3, 4), 0.5, np.float32)),
    ("TANGENT", np.full((3, 3), 0.5, np.float32)), ("TEXCOORD_0", np.full((3, 3), 0.5, np.float32)),
])
def test_attributes_have_the_components_of_the_format(tmp_path, name, values):
    gltf = Gltf()
    gltf.material(pbrMetallicRoughness={"baseColorTexture": {"index": gltf.texture(np.zeros((1, 1, 4)))}})
    gltf.primitive["attributes"][name] = gltf.array(values)
    with pytest.raises(SceneError, match=f"{name} has 3 values of {values.shape[1]} components"):
        load(gltf, tmp_path)


def test_sparse_and_interleaved_accessors(tmp_path):
    gltf = Gltf()
    rows = gltf.view(np.array([2], np.uint16).tobytes())
    values = gltf.view(np.array([[0, 7, 0]], np.float32).tobytes())
    gltf.json["accessors"][0]["sparse"] = {"count": 1, "indices": {"bufferView": rows, "componentType": 5123},
                                           "values": {"bufferView": values}}
    assert load(gltf, tmp_path).bounds[1, 1] == pytest.approx(7)

    gltf = Gltf()
    mixed = np.concatenate([TRIANGLE, np.tile([[0, 0, 1]], (3, 1))], axis=1).astype(np.float32)
    view = gltf.view(mixed.tobytes())
    gltf.json["bufferViews"][view]["byteStride"] = 24
    gltf.json["accessors"] += [
        {"bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3"},
        {"bufferView": view, "byteOffset": 12, "componentType": 5126, "count": 3, "type": "VEC3"}]
    gltf.primitive["attributes"] = {"POSITION": 1, "NORMAL": 2}
    scene = load(gltf, tmp_path)
    np.testing.assert_array_equal(scene.meshes[0].normals, [[0, 0, 1]] * 3)
    np.testing.assert_allclose(world(scene, scene.instances[0])[0], TRIANGLE)


@pytest.mark.parametrize(("mode", "triangles"), [(5, [[0, 1, 2], [2, 1, 3]]), (6, [[0, 1, 2], [0, 2, 3]])])
def test_strips_and_fans_keep_their_winding(tmp_path, mode, triangles):
    gltf = Gltf()
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    points = corners if mode == 6 else corners[[0, 1, 3, 2]]
    gltf.primitive.update(mode=mode, attributes={"POSITION": gltf.array(points)})
    scene = load(gltf, tmp_path)
    shape = world(scene, scene.instances[0])
    normals = np.cross(shape[:, 1] - shape[:, 0], shape[:, 2] - shape[:, 0])
    np.testing.assert_allclose(normals, [[0, 0, 1], [0, 0, 1]], atol=1e-6)
    assert len(scene.meshes[0].triangles) == len(triangles)


def test_instancing_shares_one_mesh(tmp_path):
    gltf = Gltf()
    gltf.json["nodes"][0] |= {"translation": [0, 0, 5], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {
        "TRANSLATION": gltf.array(np.array([[0, 0, 0], [3, 0, 0]], np.float32)),
        "ROTATION": gltf.array(np.array([[0, 0, 0, 127], [0, 0, 127, 0]], np.int8), normalized=True)}}}}
    scene = load(gltf, tmp_path)
    assert len(scene.meshes) == 1 and len(scene.instances) == 2
    np.testing.assert_allclose(world(scene, scene.instances[1])[0], [[3, 0, 5], [2, 0, 5], [3, -1, 5]], atol=1e-6)


def test_one_mesh_under_two_nodes_is_shared(tmp_path):
    gltf = Gltf()
    gltf.json["nodes"].append({"mesh": 0, "translation": [4, 0, 0]})
    gltf.json["scenes"][0]["nodes"] = [0, 1]
    scene = load(gltf, tmp_path)
    assert len(scene.meshes) == 1 and len(scene.instances) == 2


def test_cameras_and_lights_have_the_transform_of_their_node(tmp_path):
    gltf = Gltf()
    rotation = [0, np.sqrt(0.5), 0, np.sqrt(0.5)]  # a quarter about y: −z becomes −x
    gltf.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}},
                            {"type": "orthographic", "orthographic": {"xmag": 3, "ymag": 2}}]
    gltf.json["extensions"] = {"KHR_lights_punctual": {"lights": [
        {"type": "point", "intensity": 5, "color": [1, 0.5, 0], "range": 3},
        {"type": "spot", "intensity": 2, "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}},
        {"type": "directional", "intensity": 3}]}}
    gltf.json["nodes"] += [
        {"camera": 0, "name": "eye", "translation": [1, 2, 3], "rotation": rotation}, {"camera": 1},
        *({"translation": [1, 2, 3], "rotation": rotation, "extensions": {"KHR_lights_punctual": {"light": i}}}
          for i in range(3))]
    gltf.json["scenes"][0]["nodes"] = list(range(6))
    scene = load(gltf, tmp_path)
    camera = scene.cameras[scene.default_camera].at(0)
    np.testing.assert_allclose(np.subtract(camera.target, camera.eye), [-1, 0, 0], atol=1e-12)
    assert camera.eye == (1, 2, 3) and camera.fov_y_deg == pytest.approx(np.degrees(0.5))
    parallel = scene.cameras["camera 1"].at(0)
    assert parallel.orthographic_height == 4 and parallel.eye == (0, 0, 0)
    point, spot, sun = scene.lights
    assert point == PointLight((1, 2, 3), (5, 2.5, 0))
    assert isinstance(spot, SpotLight) and spot.outer_deg == pytest.approx(np.degrees(0.2))
    assert isinstance(sun, DirectionalLight) and sun.irradiance == (3, 3, 3)
    np.testing.assert_allclose([spot.direction, sun.direction], [[-1, 0, 0]] * 2, atol=1e-12)
    assert not any("range" in n for n in scene.notices)
    assert any("range" in text for text in scene.approximations)


@pytest.mark.parametrize(("kind", "intensity", "factor"), [
    ("point", 20.0, 1), ("point", 54_351.0, 683), ("spot", 54_351.0, 683), ("directional", 3.0, 1),
    ("directional", 100_000.0, 683)])
def test_lights_of_real_luminous_intensity_are_converted(tmp_path, kind, intensity, factor):
    """What lights the scene well as W/sr or W/m² counts as such; what would burn it out is in candela and lux."""
    gltf = Gltf()
    lights = [{"type": kind, "intensity": intensity}, {"type": "point", "intensity": 1.0}]
    gltf.json["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    gltf.json["nodes"] += [{"translation": [0, 1, 2], "extensions": {"KHR_lights_punctual": {"light": i}}}
                           for i in range(2)]
    gltf.json["scenes"][0]["nodes"] = [0, 1, 2]
    scene = load(gltf, tmp_path)
    first, second = scene.lights
    quantity = "irradiance" if kind == "directional" else "intensity"
    assert getattr(first, quantity)[0] == pytest.approx(intensity / factor)
    assert second.intensity[0] == pytest.approx(1 / factor)
    assert any("candela" in n for n in scene.notices) == (factor > 1)


@pytest.mark.parametrize(("name", "uri"), [("my mesh ü.bin", "my%20mesh%20%C3%BC.bin"), ("50%25.bin", "50%25.bin"),
                                           ("50%.bin", "50%25.bin"), ("my mesh.bin", "my mesh.bin")])
def test_names_of_buffers_are_percent_encoded_or_plain(tmp_path, name, uri):
    file = Gltf()
    (tmp_path / name).write_bytes(TRIANGLE.tobytes())
    file.json["buffers"][0]["uri"] = uri
    assert len(load_scene(file.save(tmp_path)).meshes[0].triangles) == 1


def test_points_and_lines_are_omitted_with_a_notice(tmp_path):
    gltf = Gltf()
    gltf.json["meshes"][0]["primitives"] += [{"attributes": {"POSITION": 0}, "mode": m} for m in (0, 1, 3)]
    scene = load(gltf, tmp_path)
    assert scene.triangles == 1
    assert any("point clouds" in n for n in scene.notices)


def _cycle(gltf):
    gltf.json["nodes"][0]["children"] = [0]


def _short_buffer(gltf):
    gltf.json["accessors"][0]["count"] = 4


def _huge_count(gltf):
    gltf.json["accessors"][0] = {"componentType": 5126, "count": 10**12, "type": "VEC3"}


def _bad_index(gltf):
    gltf.primitive["indices"] = gltf.array(np.array([0, 1, 9], np.uint16))


def _no_such_mesh(gltf):
    gltf.json["nodes"][0]["mesh"] = 3


def _wrong_types(gltf):
    gltf.json["nodes"] = "nonsense"


def _corrupt_image(gltf):
    gltf.material(pbrMetallicRoughness={"baseColorTexture": {"index": gltf.texture(b"no image")}})


def _missing_buffer(gltf):
    gltf.json["buffers"][0]["uri"] = "gone.bin"


def _old_version(gltf):
    gltf.json["asset"]["version"] = "1.0"


def _far_light(gltf):
    gltf.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    gltf.json["nodes"].append({"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 1e200, 0]})
    gltf.json["scenes"][0]["nodes"] = [0, 1]


@pytest.mark.parametrize("damage", [_cycle, _short_buffer, _huge_count, _bad_index, _no_such_mesh, _wrong_types,
                                    _corrupt_image, _missing_buffer, _old_version, _far_light])
def test_damaged_files_are_scene_errors(tmp_path, damage):
    gltf = Gltf()
    damage(gltf)
    with pytest.raises(SceneError) as caught:
        load(gltf, tmp_path)
    assert "\n" not in str(caught.value) and str(tmp_path) in str(caught.value)


def test_only_points_is_a_scene_error(tmp_path):
    gltf = Gltf()
    gltf.primitive["mode"] = 0
    with pytest.raises(SceneError, match="no triangle"):
        load(gltf, tmp_path)


def test_every_truncation_of_a_glb_is_a_scene_error(tmp_path):
    text = json.dumps(Gltf().json).encode()
    text += b" " * (-len(text) % 4)
    glb = (b"glTF" + np.array([2, 20 + len(text), len(text), 0x4E4F534A], "<u4").tobytes() + text)
    path = tmp_path / "scene.glb"
    path.write_bytes(glb)
    assert load_scene(path).triangles == 1
    for length in range(0, len(glb), 97):
        path.write_bytes(glb[:length])
        with pytest.raises(SceneError):
            load_scene(path)


@pytest.mark.parametrize("material", [-1, 1, 2])
def test_a_material_that_the_file_lacks_is_an_error(tmp_path, material):
    gltf = Gltf()
    gltf.material()
    gltf.json["meshes"][0]["primitives"][0]["material"] = material
    with pytest.raises(SceneError, match=f"no material {material}"):
        load(gltf, tmp_path)


def test_a_material_of_null_is_the_default(tmp_path):
    gltf = Gltf()
    gltf.material(pbrMetallicRoughness={"baseColorFactor": [0.5, 0.5, 0.5, 1]})
    gltf.json["meshes"][0]["primitives"][0]["material"] = None
    scene = load(gltf, tmp_path)
    assert scene.materials[scene.meshes[0].material].albedo == (1.0, 1.0, 1.0)


REFERENCES = {
    "scene": lambda json: json.update(scene=-1),
    "node": lambda json: json["scenes"][0].update(nodes=[-1]),
    "mesh": lambda json: json["nodes"][0].update(mesh=-1),
    "accessor": lambda json: json["meshes"][0]["primitives"][0]["attributes"].update(POSITION=-1),
    "buffer view": lambda json: json["accessors"][0].update(bufferView=-1),
    "buffer": lambda json: json["bufferViews"][0].update(buffer=-1),
    "camera": lambda json: json["nodes"][0].update(camera=-1),
    "texture": lambda json: json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"].update(index=-1),
    "image": lambda json: json["textures"][0].update(source=-1),
    "sampler": lambda json: json["textures"][0].update(sampler=-1),
    "light": lambda json: json["nodes"][0]["extensions"]["KHR_lights_punctual"].update(light=-1),
    "past the end": lambda json: json["nodes"][0].update(mesh=1),
}


@pytest.mark.parametrize("refer", REFERENCES.values(), ids=REFERENCES)
def test_references_to_what_is_not_there_are_one_line(tmp_path, refer):
    gltf = Gltf()
    gltf.material(pbrMetallicRoughness={"baseColorTexture": {"index": gltf.texture(np.zeros((2, 2, 3), np.uint8))}})
    gltf.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 0.1}}]
    gltf.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    gltf.json["nodes"][0] |= {"camera": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}}
    load(gltf, tmp_path)
    refer(gltf.json)
    with pytest.raises(SceneError, match=r"has no entry -?1( in (material|node) 0.*)? \(") as caught:
        load(gltf, tmp_path)
    assert "\n" not in str(caught.value)


def test_a_sparse_accessor_overwrites_no_element_from_the_end(tmp_path):
    gltf = Gltf()
    gltf.json["accessors"][0]["sparse"] = {
        "count": 1, "indices": {"bufferView": gltf.view(np.int8(-1).tobytes()), "componentType": 5120},
        "values": {"bufferView": gltf.view(np.zeros(3, np.float32).tobytes())}}
    with pytest.raises(SceneError, match="sparse accessor has negative indices"):
        load(gltf, tmp_path)
