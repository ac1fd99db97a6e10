"""glTF files with compressed meshes and textures."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from app.errors import MissingExtraError, SceneError
from app.load import draco as draco_decoder
from app.load import load_scene, meshopt
from app.load.images import decode_image
from app.scene import Scene
from tests.unit.compressed_files import DRACO, MESHOPT, compressed, draco, ktx2, meshopt_attributes
from tests.unit.load_helpers import TRIANGLE, Gltf, world

ASSETS = Path(__file__).parents[3] / "shared" / "assets"
NOISE = np.random.default_rng(0)


def asset(name: str) -> Scene:
    path = ASSETS / name / f"{name}.glb"
    if not path.exists():
        pytest.skip(f"needs {path}")
    return load_scene(path)


def triangles(scene: Scene) -> np.ndarray:
    return np.concatenate([world(scene, instance) for instance in scene.instances])


@pytest.mark.parametrize(("plain", "packed", "tolerance"), [
    ("RobotExpressive", "RobotExpressive-Meshopt", 1e-3),
    ("RiggedFigure", "RiggedFigure-Draco", 1e-3),
    ("MorphPrimitivesTest", "MorphPrimitivesTest-Draco", 1e-3),
    ("AnimatedMorphCube", "AnimatedMorphCube-Quantized", 1e-3),
])
def test_a_compressed_asset_has_the_geometry_of_its_plain_twin(plain, packed, tolerance):
    expected, scene = triangles(asset(plain)), triangles(asset(packed))
    extent = np.ptp(expected.reshape(-1, 3), axis=0).max()
    assert len(scene) == len(expected)
    for of, to in ((scene, expected), (expected, scene)):
        assert cKDTree(to.mean(axis=1)).query(of.mean(axis=1))[0].max() < tolerance * extent
    area = [np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1).sum() for t in (scene, expected)]
    assert area[0] == pytest.approx(area[1], rel=2e-3)


@pytest.mark.parametrize("name", ["BoxMeshopt", "BoxSparseMorph", "BoxWebP"])
def test_boxes_are_unit_cubes(name):
    scene = asset(name)
    shape = triangles(scene)
    normals = np.cross(shape[:, 1] - shape[:, 0], shape[:, 2] - shape[:, 0])
    assert len(shape) == 12
    np.testing.assert_allclose(scene.bounds, [[-0.5] * 3, [0.5] * 3], atol=1e-3)
    np.testing.assert_allclose(np.abs(normals).max(axis=1), 1.0, atol=5e-3)
    outwards = np.einsum("td,td->t", normals, shape.mean(axis=1)) > 0
    assert (outwards == (name != "BoxSparseMorph")).all()  # the triangles of that file face inwards


def test_an_asset_with_basis_textures_has_them_all():
    scene = asset("StainedGlassLamp")
    maps = [m.albedo_map for m in scene.materials if m.albedo_map is not None]
    assert maps and all(min(m.pixels.shape[:2]) >= 256 and m.pixels[..., :3].std() > 1 for m in maps)
    assert not any("unsupported" in notice or "not supported" in notice for notice in scene.notices)


def test_all_compressions_in_one_file(tmp_path):
    scene = load_scene(compressed().save(tmp_path))
    np.testing.assert_allclose(triangles(scene), [TRIANGLE, TRIANGLE], atol=1e-4)
    pixels = scene.materials[0].albedo_map.pixels
    assert pixels.shape == (4, 8, 4) and (pixels == (10, 200, 30, 255)).all()
    assert not any("support" in notice for notice in scene.notices)


@pytest.mark.parametrize(("module", "package"), [("DracoPy", "DracoPy"), ("opengl_basisu", "opengl_basisu")])
def test_a_missing_package_is_named_with_its_extra(tmp_path, monkeypatch, module, package):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=rf"{package}.*afterglow\[assets\]"):
        load_scene(compressed().save(tmp_path))


def test_an_uncompressed_copy_in_the_file_needs_no_package(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    gltf = Gltf()
    gltf.primitive["extensions"] = {DRACO: {"bufferView": 0, "attributes": {"POSITION": 0}}}
    np.testing.assert_allclose(triangles(load_scene(gltf.save(tmp_path))), [TRIANGLE])


@pytest.mark.parametrize("count", [0, 1, 16, 17, 255, 257, 700])
@pytest.mark.parametrize("stride", [4, 12, 64, 256])
def test_meshopt_attributes(count, stride):
    smooth = np.cumsum(NOISE.integers(-2, 3, (count, stride)), axis=0).astype(np.uint8)
    values = np.where(NOISE.random((count, stride)) < 0.05, NOISE.integers(0, 256, (count, stride)), smooth)
    values = np.where(np.arange(stride) % 5 == 0, 7, values).astype(np.uint8)
    for rng in (None, NOISE):
        np.testing.assert_array_equal(meshopt.decode_attributes(meshopt_attributes(values, rng), count, stride), values)


def test_meshopt_deltas_of_the_specification():
    """The worked example of 4-bit deltas in EXT_meshopt_compression, appendix A."""
    group = bytes([0x17, 0x5F, 0xF0, 0xBC, 0x77, 0xA9, 0x21, 0x00, 0x34, 0xB5])
    deltas = [-1, -4, -3, 26, -91, 0, -6, 6, -4, -4, 5, -5, 1, -1, 0, 0]
    stream = b"\xa0" + b"\x02" + group + b"\0" * 3 + bytes(28) + bytes([10, 20, 30, 40])
    expected = np.tile([10, 20, 30, 40], (16, 1))
    expected[:, 0] += np.cumsum(deltas)
    np.testing.assert_array_equal(meshopt.decode_attributes(stream, 16, 4), expected.astype(np.uint8))


def test_meshopt_triangles():
    """Every kind of code, followed by hand through the specification."""
    codes = [0xF0, 0x00, 0x10, 0x04, 0x0E, 0x0D, 0x0F, 0xF1, 0xFE, 0xFF]
    extra = [12, 0x20, 0xFF, 5, 2, 4]
    table = [0x00, 0x01, *[0] * 14]
    triangles = meshopt.decode_triangles(bytes([0xE1, *codes, *extra, *table]), 3 * len(codes)).reshape(-1, 3)
    assert triangles.tolist() == [
        [0, 1, 2],     # three new vertices; edges 10, 21, 02
        [0, 2, 3],     # newest edge 02, new vertex; edges 32, 03
        [3, 2, 4],     # edge before it; edges 42, 34
        [3, 4, 0],     # newest edge, the vertex four before the newest; edges 04, 30
        [3, 0, 1],     # newest edge, last + 1; edges 10, 31
        [3, 1, 0],     # newest edge, last − 1; edges 01, 30
        [3, 0, 6],     # newest edge, a difference of 6; edges 60, 36
        [5, 6, 6],     # two new vertices and the newest of the others
        [7, 5, 8],     # 0x20: a new vertex, the one before the newest, a new one
        [3, 4, 6],     # 0xff: differences −3, 1, 2
    ]


def test_meshopt_indices():
    """Differences 20, 1 and 513 from one baseline, −4 from the other."""
    stream = bytes([0xD1, 20 << 2, 1 << 2, 3 << 2 | 0b11, 0x84, 0x10]) + bytes(4)
    assert meshopt.decode_indices(stream, 4).tolist() == [20, 21, 2**32 - 4, 21 + 513]


def test_meshopt_filters():
    count = 500
    directions = NOISE.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    projected = directions / np.abs(directions).sum(axis=1, keepdims=True)
    folded = np.where(projected[:, 2:] < 0, (1 - np.abs(projected[:, 1::-1])) * np.copysign(1, projected[:, :2]),
                      projected[:, :2])
    codes = np.concatenate([np.rint(folded * 2047), np.full((count, 1), 2047), np.full((count, 1), 5)], axis=1)
    decoded = _filter(codes.astype("<i2"), "OCTAHEDRAL").view("<i2").reshape(count, 4)
    np.testing.assert_allclose(decoded[:, :3] / 32767, directions, atol=2e-3)
    assert (decoded[:, 3] == 5).all()

    rotations = NOISE.normal(size=(count, 4))
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    largest = np.abs(rotations).argmax(axis=1)
    rotations *= np.sign(np.take_along_axis(rotations, largest[:, None], 1))
    others = np.take_along_axis(rotations, (largest[:, None] + [1, 2, 3]) % 4, 1)
    codes = np.concatenate([np.rint(others * np.sqrt(2) * 2047), (2047 & ~3 | largest)[:, None]], axis=1)
    decoded = _filter(codes.astype("<i2"), "QUATERNION").view("<i2").reshape(count, 4)
    np.testing.assert_allclose(decoded / 32767, rotations, atol=2e-3)

    mantissas, exponents = np.array([5, -3, 2**22]), np.array([-10, 4, -100])
    codes = (exponents << 24 | mantissas & 0xFFFFFF).astype("<i4")
    decoded = _filter(codes.reshape(1, 3), "EXPONENTIAL").view("<f4")
    np.testing.assert_allclose(decoded, mantissas * 2.0**exponents, rtol=1e-7)


def _filter(codes: np.ndarray, name: str) -> np.ndarray:
    """What the decoder makes of elements that went through no filter."""
    raw = np.ascontiguousarray(codes).view(np.uint8).reshape(len(codes), -1)
    return np.frombuffer(meshopt.decode(meshopt_attributes(raw), len(raw), raw.shape[1], "ATTRIBUTES", name), np.uint8)


@pytest.mark.parametrize(("count", "stride", "mode", "name"), [
    (10**12, 4, "ATTRIBUTES", "NONE"), (-1, 4, "ATTRIBUTES", "NONE"), (4, 0, "ATTRIBUTES", "NONE"),
    (4, 6, "ATTRIBUTES", "NONE"), (4, 4, "ATTRIBUTES", "QUATERNION"), (4, 4, "ATTRIBUTES", "COLOR"),
    (3, 4, "TRIANGLES", "NONE"), (3, 4, "LINES", "NONE"), (3, 4, "INDICES", "NONE"), (5, 4, "ATTRIBUTES", "NONE"),
    (100, 4, "ATTRIBUTES", "NONE"),
])
def test_meshopt_streams_that_do_not_fit_their_description(count, stride, mode, name):
    stream = meshopt_attributes(np.arange(16, dtype=np.uint8).reshape(4, 4)[[0, 1, 2, 3] * 5])
    with pytest.raises(ValueError, match="meshopt"):
        meshopt.decode(stream, count, stride, mode, name)


@pytest.mark.parametrize("method", [0, 1])
def test_draco_data_that_announce_more_than_they_hold(method):
    def varint(value: int) -> bytes:
        return bytes([value & 127 | 128, value >> 7 & 127 | 128, value >> 14 & 127 | 128, value >> 21])

    metadata = bytes([1, 0, 1, 1, 65, 2, 0, 0, 0, 0, 1, 1, 66, 0, 0])  # of an attribute; of the mesh, with a child
    for flags, before in ((0, b""), (0x8000, metadata)):
        header = struct.pack("<5sBBBBH", b"DRACO", 2, 2, 1, method, flags) + before + bytes(method)
        with pytest.raises(ValueError, match="more faces or vertices than it can hold"):
            draco_decoder.decode(header + varint(10) + varint(100_000_000) + bytes(300))
    positions, faces = NOISE.random((30, 3), np.float32), np.arange(30).reshape(10, 3)
    decoded, attributes = draco_decoder.decode(draco(positions, faces))
    np.testing.assert_array_equal(decoded, faces)
    np.testing.assert_allclose(attributes[0], positions, atol=1e-3)


@pytest.mark.parametrize("data", [b"", b"DRACO", b"DRACO\2\2\1\1\0\0", bytes(100), b"DRACO\1\1\1\1\0\0" + bytes(50)])
def test_draco_garbage_is_one_line(tmp_path, data):
    gltf = compressed()
    gltf.primitive["extensions"][DRACO]["bufferView"] = gltf.view(data)
    with pytest.raises(SceneError, match="Draco") as caught:
        load_scene(gltf.save(tmp_path))
    assert "\n" not in str(caught.value)


def test_a_view_of_a_buffer_that_only_describes_is_an_error(tmp_path):
    gltf = compressed()
    for view in gltf.json["bufferViews"]:
        view.pop("extensions", None)
    with pytest.raises(SceneError, match="past the end"):
        load_scene(gltf.save(tmp_path))
    assert MESHOPT in gltf.json["extensionsRequired"]


@pytest.mark.parametrize("data", [ktx2(8, 4, (0, 0, 0, 255), blocks=1), ktx2(8, 4, (0, 0, 0, 255))[:60],
                                  b"\xabKTX 20\xbb\r\n\x1a\n"])
def test_damaged_ktx2_is_an_error(data):
    with pytest.raises(SceneError, match="corrupt"):
        decode_image(data, "image 0")
