"""Small encoders of what glTF files may be compressed with, for tests of the decoders."""

from __future__ import annotations

import struct
from typing import Any

import DracoPy
import numpy as np

from tests.unit.load_helpers import TRIANGLE, Gltf

MESHOPT, DRACO, BASISU = "EXT_meshopt_compression", "KHR_draco_mesh_compression", "KHR_texture_basisu"
_SOLID = 0x17  # UASTC: a block of one colour


def ktx2(width: int, height: int, color: tuple[int, int, int, int], blocks: int | None = None) -> bytes:
    """A KTX2 file of UASTC blocks that all have one colour; ``blocks`` of them if its header shall lie."""
    block = (_SOLID | int.from_bytes(bytes(color), "little") << 5).to_bytes(16, "little")
    data = block * (-(-width // 4) * -(-height // 4) if blocks is None else blocks)
    descriptor = struct.pack("<IIHH8B8B", 44, 0, 2, 40, 166, 1, 2, 0, 3, 3, 0, 0, 16, *bytes(7))
    descriptor += struct.pack("<HBB4BII", 0, 127, 3, *bytes(4), 0, 0xFFFFFFFF)
    start = 104 + len(descriptor) + 4
    header = struct.pack("<12s9I", b"\xabKTX 20\xbb\r\n\x1a\n", 0, 1, width, height, 0, 0, 1, 1, 0)
    header += struct.pack("<4I2Q3Q", 104, len(descriptor), 0, 0, 0, 0, start, len(data), len(data))
    return header + descriptor + bytes(4) + data


def meshopt_attributes(values: np.ndarray, rng: np.random.Generator | None = None) -> bytes:
    """Encode elements (mode 0), uint8, shape (N, stride); ``rng`` picks larger encodings than the smallest."""
    count, stride = values.shape
    baseline = values[0] if count else np.zeros(stride, np.uint8)
    differences = np.diff(values, axis=0, prepend=baseline[None])
    codes = (differences << 1) ^ np.where(differences & 128, 255, 0).astype(np.uint8)  # zigzag
    stream = b"\xa0"
    block = min(8192 // stride // 16 * 16, 256)
    for start in range(0, count, block):
        for column in codes[start:start + block].T:
            groups = np.pad(column, (0, -len(column) % 16)).reshape(-1, 16)
            modes = [max(_smallest_mode(g), 0 if rng is None else int(rng.integers(4))) for g in groups]
            padded = modes + [0] * (-len(modes) % 4)
            stream += bytes(a | b << 2 | c << 4 | d << 6 for a, b, c, d in zip(*[iter(padded)] * 4, strict=True))
            stream += b"".join(_group(g.tolist(), mode) for g, mode in zip(groups, modes, strict=True))
    return stream + bytes(max(32 - stride, 0)) + baseline.tobytes()


def _smallest_mode(group: np.ndarray) -> int:
    return 0 if not group.any() else 1 if group.max() < 3 else 2 if group.max() < 15 else 3


def _group(codes: list[int], mode: int) -> bytes:
    """16 codes in 0, 2, 4 or 8 bits each, and those that do not fit after them."""
    if mode in (0, 3):
        return bytes(codes if mode else [])
    bits = 2 * mode
    sentinel = 2**bits - 1
    packed = sum(min(c, sentinel) << bits * (15 - i) for i, c in enumerate(codes)).to_bytes(2 * bits, "big")
    return packed + bytes(c for c in codes if c >= sentinel)


def draco(positions: np.ndarray, triangles: np.ndarray) -> bytes:
    return DracoPy.encode(positions, triangles, quantization_bits=14, compression_level=1, preserve_order=True)


def compressed() -> Gltf:
    """A triangle in Draco, one in meshopt, and a KTX2 texture on both."""
    file = Gltf()
    color = {"index": file.texture(ktx2(8, 4, (10, 200, 30, 255)))}
    texture = file.json["textures"][0]
    texture["extensions"] = {BASISU: {"source": texture.pop("source")}}
    file.material(pbrMetallicRoughness={"baseColorTexture": color})
    file.json["extensionsRequired"] = [MESHOPT, DRACO, BASISU, "KHR_mesh_quantization"]
    file.json["accessors"] = []
    indices = bytes([0xE1, 0xF0]) + bytes(16)
    file.json["meshes"][0]["primitives"] = [
        {"attributes": {"POSITION": _described(file, "VEC3")}, "indices": _described(file, "SCALAR", 5125),
         "material": 0, "extensions": {DRACO: {
             "bufferView": file.view(draco(TRIANGLE, np.array([[0, 1, 2]]))), "attributes": {"POSITION": 0}}}},
        {"attributes": {"POSITION": _packed(file, meshopt_attributes(TRIANGLE.view(np.uint8)), 12, 5126, "VEC3")},
         "indices": _packed(file, indices, 2, 5123, "SCALAR", mode="TRIANGLES"), "material": 0}]
    return file


def _described(file: Gltf, kind: str, component: int = 5126) -> int:
    """Add an accessor without data."""
    file.json["accessors"].append({"componentType": component, "count": 3, "type": kind})
    return len(file.json["accessors"]) - 1


def _packed(file: Gltf, data: bytes, stride: int, component: int, kind: str, **more: Any) -> int:
    """Add an accessor of three elements in a compressed buffer view."""
    source = file.json["bufferViews"][file.view(data)]["buffer"]
    extension = {"buffer": source, "byteLength": len(data), "byteStride": stride, "count": 3, "mode": "ATTRIBUTES"}
    file.json["buffers"].append({"byteLength": 3 * stride, "extensions": {MESHOPT: {"fallback": True}}})
    file.json["bufferViews"].append({"buffer": len(file.json["buffers"]) - 1, "byteLength": 3 * stride,
                                     "extensions": {MESHOPT: extension | more}})
    index = _described(file, kind, component)
    file.json["accessors"][index]["bufferView"] = len(file.json["bufferViews"]) - 1
    return index
