"""Errors for files that are not scenes."""

from __future__ import annotations

import numpy as np
import pytest

from app.errors import SceneError
from app.load import load_scene
from tests.unit.load_helpers import Gltf


def test_missing_file_folder_and_unknown_kind(tmp_path):
    with pytest.raises(SceneError, match="no such scene file"):
        load_scene(tmp_path / "gone.obj")
    with pytest.raises(SceneError, match="folder"):
        load_scene(tmp_path)
    (tmp_path / "scene.stl").write_text("solid")
    with pytest.raises(SceneError, match=r"\.obj, \.gltf, \.glb, \.ply"):
        load_scene(tmp_path / "scene.stl")


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb", ".gltf"])
@pytest.mark.parametrize("content", [
    b"", b"garbage\n", bytes(range(256)) * 64, np.random.default_rng(3).bytes(9000), b"{" * 5000, b"v 1 2\nf 1 2 3\n",
    b"ply\nformat binary_little_endian 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n",
    b"glTF\x02\x00\x00\x00\xff\xff\xff\xff\xff\xff\xff\xffJSON{}",
], ids=["empty", "text", "bytes", "random", "braces", "half-obj", "huge-ply", "huge-glb"])
def test_corrupt_files_give_a_one_line_error(tmp_path, suffix, content):
    path = tmp_path / f"scene{suffix}"
    path.write_bytes(content)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    message = str(caught.value)
    assert "\n" not in message and str(path) in message and "Error" not in message


@pytest.mark.parametrize(("name", "content", "match"), [
    ("a.obj", "v 0 0 0\nv 1 0 0\nf 1 2 7\n", "a vertex, normal or uv that the file does not list"),
    ("a.obj", "glTF\x02\0\0\0", "not text"),
    ("a.glb", "", "it is empty"),
    ("a.glb", "PNG\r\n", "it does not begin as a binary glTF file does"),
    ("a.gltf", "[" * 100_000, "nested too deeply"),
    ("a.gltf", ('{"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], '
               '"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}]}'), "'accessors' is missing"),
    ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "a face has the vertex 0, but the first one has the number 1"),
    ("a.obj", "v 0 0 a\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "the line 'v 0 0 a' holds something else than numbers"),
    ("a.obj", "v 0 0 0\nv 1 0 0\nf 1 2\n", "no triangle to draw"),
    ("a.ply", ("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
               "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n"),
     "a face has a vertex that the file does not list"),
    ("a.gltf", '{"asset": {"version": "2.0"}, "buffers": [], "nodes": 3}', "a value is of the wrong kind"),
    ("a.glb", "glTF\x02", "it ends too early"),
    ("a.gltf", '{"asset": {"version": "2.0"}, "materials": [{"alphaCutoff": "x", "alphaMode": "MASK"}]}',
     "a text is where a number is expected in material 0 "),
    ("a.gltf", ('{"asset": {"version": "2.0"}, "materials": [{"name": "a"}, {"name": "wood", "pbrMetallicRoughness": '
                '{"baseColorFactor": [1, 1, 1]}}]}'),
     r"a list is too short, or an index too large, in material 1 \('wood'\) "),
    ("a.gltf", '{"asset": {"version": "2.0"}, "meshes": [], "nodes": [{"name": "chair", "mesh": 3}]}',
     r" in node 0 \('chair'\) "),
    ("a.glb", "glTF\x02\0\0\0\x14\0\0\0\0\0\0\0BIN\0", "no JSON chunk"),
])
def test_errors_say_what_is_wrong_with_a_file(tmp_path, name, content, match):
    (tmp_path / name).write_text(content)
    with pytest.raises(SceneError, match=match):
        load_scene(tmp_path / name)


def test_a_file_whose_nodes_are_all_scaled_to_nothing_has_nothing_to_draw(tmp_path):
    file = Gltf()
    file.json["nodes"][0]["scale"] = [0, 0, 0]
    with pytest.raises(SceneError, match="no triangle to draw"):
        load_scene(file.save(tmp_path))


@pytest.mark.parametrize(("key", "value", "match"), [
    ("componentType", 5130, "componentType 5130 is none of 5120, "),
    ("type", "VEC5", "type 'VEC5' is none of SCALAR, ")])
def test_errors_name_unknown_kinds_of_values(tmp_path, key, value, match):
    file = Gltf()
    file.json["accessors"][0][key] = value
    with pytest.raises(SceneError, match=match):
        load_scene(file.save(tmp_path))
