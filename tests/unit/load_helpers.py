"""Small scene files for tests of the loader."""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)


def png(pixels: np.ndarray) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(stream, "PNG")
    return stream.getvalue()


class Gltf:
    """Builds a glTF file whose accessors are in data URIs."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0, "name": "thing"}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "buffers": [], "bufferViews": [], "accessors": [],
        }
        self.array(TRIANGLE)

    @property
    def primitive(self) -> dict[str, Any]:
        return self.json["meshes"][0]["primitives"][0]

    def view(self, data: bytes) -> int:
        uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
        self.json["buffers"].append({"byteLength": len(data), "uri": uri})
        self.json["bufferViews"].append({"buffer": len(self.json["buffers"]) - 1, "byteLength": len(data)})
        return len(self.json["bufferViews"]) - 1

    def array(self, values: np.ndarray, **more: Any) -> int:
        values = np.asarray(values)
        kinds = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
        self.json["accessors"].append({
            "bufferView": self.view(values.tobytes()), "componentType": kinds[values.dtype.str[1:]],
            "count": len(values), "type": "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}", **more})
        return len(self.json["accessors"]) - 1

    def texture(self, pixels: np.ndarray | bytes, **sampler: int) -> int:
        data = pixels if isinstance(pixels, bytes) else png(pixels)
        self.json.setdefault("images", []).append({"bufferView": self.view(data), "mimeType": "image/png"})
        self.json.setdefault("samplers", []).append(sampler)
        self.json.setdefault("textures", []).append({
            "source": len(self.json["images"]) - 1, "sampler": len(self.json["samplers"]) - 1})
        return len(self.json["textures"]) - 1

    def material(self, **spec: Any) -> None:
        self.json.setdefault("materials", []).append(spec)
        self.primitive["material"] = len(self.json["materials"]) - 1

    def save(self, folder: Path, name: str = "scene.gltf") -> Path:
        path = folder / name
        path.write_text(json.dumps(self.json))
        return path


def write_obj(folder: Path, obj: str, mtl: str = "", name: str = "scene.obj") -> Path:
    path = folder / name
    if mtl:
        (folder / "scene.mtl").write_text(mtl)
        obj = "mtllib scene.mtl\n" + obj
    path.write_text(obj)
    return path


QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def world(scene, instance) -> np.ndarray:
    """World-space corners of an instance's triangles, shape (T, 3, 3)."""
    mesh = scene.meshes[instance.mesh]
    points = mesh.positions.astype(np.float64) @ instance.transform[:3, :3].T + instance.transform[:3, 3]
    return points[mesh.triangles]
