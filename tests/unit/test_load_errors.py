"""Errors for files that are not scenes."""

from __future__ import annotations

import numpy as np
import pytest

from app.errors import SceneError
from app.load import load_scene


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
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)
