"""glTF files made to exhaust memory or time: one line, exit code 2, in a process of bounded size."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from struct import pack

import numpy as np
import pytest

from tests.unit.compressed_files import DRACO, MESHOPT, compressed, ktx2
from tests.unit.load_helpers import Gltf

ROOT = Path(__file__).parents[2]
MAX_SECONDS = 60.0  # of the processor
MAX_MEGABYTES = 2500.0
SIDE = 60_000

# Runs a command and prints its peak memory in KiB and its processor time in seconds. It is a small process in between,
# because Linux also counts what a process had before it became another program, and the tests' own process is large.
MEASURE = ("import resource, subprocess, sys; code = subprocess.call(sys.argv[1:]); "
           "usage = resource.getrusage(resource.RUSAGE_CHILDREN); "
           "print(usage.ru_maxrss, usage.ru_utime + usage.ru_stime); sys.exit(code)")


def textured(image: bytes) -> Gltf:
    file = Gltf()
    file.material(pbrMetallicRoughness={"baseColorTexture": {"index": file.texture(image)}})
    return file


def png_bomb() -> Gltf:
    """A black PNG of 60000×60000 pixels, 3.6 GB, in a few kilobytes."""
    def chunk(kind: bytes, data: bytes) -> bytes:
        return pack(">I", len(data)) + kind + data + pack(">I", zlib.crc32(kind + data))

    rows = zlib.compress(bytes(50_000_000), 9)
    return textured(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", pack(">IIBBBBB", SIDE, SIDE, 8, 0, 0, 0, 0))
                    + chunk(b"IDAT", rows) + chunk(b"IEND", b""))


def webp_bomb() -> Gltf:
    """The header of a WebP of 16384×16384 pixels, the most that WebP has."""
    frame = b"\x2f" + pack("<I", 16383 | 16383 << 14) + bytes(20)
    body = b"WEBPVP8L" + pack("<I", len(frame)) + frame + bytes(len(frame) % 2)
    return textured(b"RIFF" + pack("<I", len(body)) + body)


def ktx2_bomb() -> Gltf:
    return textured(ktx2(SIDE, SIDE, (0, 0, 0, 255), blocks=4))


def zeros_without_data() -> Gltf:
    file = Gltf()
    file.json["accessors"][0] = {"componentType": 5126, "count": 10**9, "type": "VEC3"}
    return file


def many_instances() -> Gltf:
    file = Gltf()
    file.json["accessors"].append({"componentType": 5126, "count": 20_000_000, "type": "VEC3"})
    file.json["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 1}}}
    return file


def nodes_times_instances() -> Gltf:
    file = Gltf()
    attributes = {"TRANSLATION": file.array(np.zeros((2000, 3), np.float32))}
    file.json["nodes"] = [{"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}] * 2000
    file.json["scenes"][0]["nodes"] = list(range(2000))
    return file


def repeated_primitives() -> Gltf:
    """A mesh of a million triangles, a thousand times."""
    file = Gltf()
    file.primitive["indices"] = file.array(np.tile(np.array([0, 1, 2], np.uint8), 1_000_000))
    file.json["meshes"][0]["primitives"] *= 1000
    return file


def node_cycle() -> Gltf:
    file = Gltf()
    file.json["nodes"] = [{"children": [1]}, {"children": [0], "mesh": 0}]
    return file


def deep_json() -> Gltf:
    file = Gltf()
    file.json["extras"] = "DEEP"
    return file


def meshopt_count() -> Gltf:
    file = compressed()
    for view in file.json["bufferViews"]:
        if "extensions" in view:
            view["extensions"][MESHOPT]["count"] = 10**9
    return file


def meshopt_repeated() -> Gltf:
    """Half a megabyte of meshopt data that unpack to 32 MB, 200 times."""
    file = compressed()
    stream = b"\xa0" + bytes(2**23 // 256 * 4 * 4) + bytes(32)
    source = file.json["bufferViews"][file.view(stream)]["buffer"]
    extension = {"buffer": source, "byteLength": len(stream), "byteStride": 4, "count": 2**23, "mode": "ATTRIBUTES"}
    file.json["bufferViews"] += [{"buffer": source, "byteLength": 2**25, "extensions": {MESHOPT: extension}}] * 200
    return file


def draco_garbage() -> Gltf:
    file = compressed()
    file.primitive["extensions"][DRACO]["bufferView"] = file.view(b"DRACO\2\2\1\1\0\0" + b"\xff" * 5000)
    return file


@pytest.mark.parametrize(("make", "said"), [
    (png_bomb, "too large"), (webp_bomb, "too large"), (ktx2_bomb, "too large"),
    (zeros_without_data, "no data"), (many_instances, "too many objects"), (nodes_times_instances, "too many objects"),
    (repeated_primitives, "too large"), (node_cycle, "scene"), (deep_json, "corrupt"),
    (meshopt_count, "meshopt"), (meshopt_repeated, "1 GiB"), (draco_garbage, "Draco"),
])
def test_one_line_in_bounded_memory_and_time(make: Callable[[], Gltf], said: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.gltf"
    path.write_text(json.dumps(make().json).replace('"DEEP"', "[" * 100_000 + "]" * 100_000))
    command = [sys.executable, "-m", "app", str(path), "--size", "8x8", "--model", "none"]
    process = subprocess.run([sys.executable, "-c", MEASURE, *command], cwd=tmp_path, capture_output=True, text=True,
                             env={**os.environ, "PYTHONPATH": str(ROOT)}, check=False)
    lines = [line for line in process.stderr.splitlines() if not line.startswith("note:")]
    assert (process.returncode, len(lines)) == (2, 1), process.stderr
    kibibytes, seconds = map(float, process.stdout.split())  # the command itself prints nothing there
    assert kibibytes / 1024 < MAX_MEGABYTES
    assert seconds < MAX_SECONDS
    assert re.fullmatch(r"error: .+: .+ \(.+\)", lines[0]) and said in lines[0], lines[0]
