"""The container of a glTF file: its JSON, its buffers and its accessors.

trimesh 5.2 reads common accessors only (sparse ones become zeros, normalised ones integers) and supports neither
instancing nor a second uv set, so accessors are read here.
"""

import base64
import binascii
import json
import struct
import urllib.parse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.errors import SceneError

_COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942
_MAX_ZEROS = 2**28


@dataclass(frozen=True, eq=False)
class GltfFile:
    """The JSON of a glTF file and its binary buffers."""

    path: Path
    json: dict[str, Any]
    buffers: tuple[bytes, ...]

    def items(self, key: str) -> list[dict[str, Any]]:
        """A top-level array of the JSON, empty if missing."""
        return list(self.json.get(key, []))

    def view(self, index: int) -> bytes:
        """The bytes of a buffer view."""
        view = self.json["bufferViews"][index]
        start = view.get("byteOffset", 0)
        data: bytes = self.buffers[view["buffer"]][start:start + view["byteLength"]]
        if len(data) != view["byteLength"]:
            raise ValueError(f"buffer view {index} reaches past the end of its buffer")
        return data

    def image(self, index: int) -> bytes:
        """The encoded bytes of an image."""
        image = self.json["images"][index]
        return self.view(image["bufferView"]) if "bufferView" in image else _fetch(image["uri"], self.path)

    def accessor(self, index: int) -> NDArray[Any]:
        """Values of an accessor, shape (count, width); normalised integers become floats."""
        spec = self.json["accessors"][index]
        dtype = np.dtype(_COMPONENTS[spec["componentType"]]).newbyteorder("<")
        count, width = spec["count"], _WIDTHS[spec["type"]]
        if "bufferView" in spec:
            view = self.json["bufferViews"][spec["bufferView"]]
            values = _strided(self.view(spec["bufferView"]), dtype, count, width, spec.get("byteOffset", 0),
                              view.get("byteStride", dtype.itemsize * width))
        else:
            if count * width > _MAX_ZEROS:
                raise ValueError(f"accessor {index} has {count} elements but no data")
            values = np.zeros((count, width), dtype)
        if "sparse" in spec:
            values = self._overwrite(values.copy(), spec["sparse"])
        return np.maximum(values / np.iinfo(values.dtype).max, -1.0) if spec.get("normalized") else values

    def _overwrite(self, values: NDArray[Any], sparse: dict[str, Any]) -> NDArray[Any]:
        where, what, count = sparse["indices"], sparse["values"], sparse["count"]
        dtype = np.dtype(_COMPONENTS[where["componentType"]]).newbyteorder("<")
        rows = _strided(self.view(where["bufferView"]), dtype, count, 1, where.get("byteOffset", 0), dtype.itemsize)
        values[rows[:, 0]] = _strided(self.view(what["bufferView"]), values.dtype, count, values.shape[1],
                                      what.get("byteOffset", 0), values.dtype.itemsize * values.shape[1])
        return values


def open_gltf(path: Path) -> GltfFile:
    """Read a ``.gltf`` or ``.glb`` file and all its buffers.

    Raises
    ------
    SceneError
        When a buffer's file can't be read.
    ValueError, KeyError, struct.error
        When the content is not valid glTF 2.
    """
    data = path.read_bytes()
    binary = b""
    if data[:4] == b"glTF":
        data, binary = _split_glb(data)
    document = json.loads(data.decode("utf-8-sig"))
    if not isinstance(document, dict) or "asset" not in document:
        raise ValueError("it has no glTF asset")
    version = str(document["asset"].get("version", ""))
    if not version.startswith("2"):
        raise ValueError(f"glTF version {version}; only version 2 is supported")
    buffers = tuple(_fetch(b["uri"], path) if "uri" in b else binary for b in document.get("buffers", []))
    return GltfFile(path, document, buffers)


def _split_glb(data: bytes) -> tuple[bytes, bytes]:
    """The JSON chunk and the binary chunk of a GLB file."""
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise ValueError(f"GLB version {version}; only version 2 is supported")
    if length > len(data):
        raise ValueError(f"truncated: {len(data)} of {length} bytes")
    chunks: dict[int, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        chunks.setdefault(kind, data[at + 8:at + 8 + size])
        at += 8 + size
    return chunks[_JSON_CHUNK], chunks.get(_BINARY_CHUNK, b"")


def _fetch(uri: str, beside: Path) -> bytes:
    if uri.startswith("data:"):
        try:
            return base64.b64decode(uri.split(",", 1)[1], validate=True)
        except (binascii.Error, IndexError) as error:
            raise ValueError("a data URI is not base64") from error
    file = beside.parent / urllib.parse.unquote(uri)
    try:
        return file.read_bytes()
    except OSError as error:
        raise SceneError(f"can't read this file, which {beside.name} refers to", file,
                         "expected it beside the scene") from error


def _strided(data: bytes, dtype: np.dtype[Any], count: int, width: int, offset: int, stride: int) -> NDArray[Any]:
    row = dtype.itemsize * width
    if count < 0 or offset < 0 or stride < row or (count and offset + (count - 1) * stride + row > len(data)):
        raise ValueError("an accessor reaches past the end of its buffer view")
    if not count:
        return np.zeros((0, width), dtype)
    return np.ndarray((count, width), dtype, data, offset, (stride, dtype.itemsize))
