"""PLY files."""

from __future__ import annotations

import numpy as np
import pytest

from app.errors import SceneError
from app.load import load_scene

HEADER = "ply\nformat ascii 1.0\nelement vertex {v}\nproperty float x\nproperty float y\nproperty float z\n{more}"
FACES = "element face {f}\nproperty list uchar int vertex_indices\nend_header\n"


def write(folder, vertices, faces, more=""):
    path = folder / "scene.ply"
    path.write_text(HEADER.format(v=len(vertices), more=more) + FACES.format(f=len(faces))
                    + "".join(" ".join(map(str, row)) + "\n" for row in [*vertices, *([len(f), *f] for f in faces)]))
    return path


def test_missing_normals_are_area_weighted_means(tmp_path):
    roof = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 3)]
    scene = load_scene(write(tmp_path, roof, [(0, 1, 2), (0, 3, 1)]))
    np.testing.assert_allclose(scene.meshes[0].normals[0], np.array([0, 3, 1]) / np.sqrt(10), atol=1e-6)


def test_byte_colours_are_srgb(tmp_path):
    more = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    rows = [(0, 0, 0, 255, 0, 188), (1, 0, 0, 255, 0, 188), (0, 1, 0, 255, 0, 188)]
    scene = load_scene(write(tmp_path, rows, [(0, 1, 2)], more))
    np.testing.assert_allclose(scene.meshes[0].colors, [[1, 0, 0.503, 1]] * 3, atol=0.002)
    assert scene.materials[0].albedo == (1, 1, 1)


def test_quads_and_mixed_polygons(tmp_path):
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0)]
    assert load_scene(write(tmp_path, square, [(0, 1, 2, 3)])).triangles == 2
    assert load_scene(write(tmp_path, square, [(0, 1, 2, 3), (1, 4, 2)])).triangles == 3


@pytest.mark.parametrize("faces", [[], [(0, 1, 7)]])
def test_no_triangle_or_a_wrong_index_is_a_scene_error(tmp_path, faces):
    with pytest.raises(SceneError):
        load_scene(write(tmp_path, [(0, 0, 0), (1, 0, 0), (0, 1, 0)], faces))
