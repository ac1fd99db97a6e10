"""The container of a glTF file: its JSON, its buffers and its accessors.

Compressed parts are unpacked when the file is opened, and the JSON is rewritten as if they had never been compressed.

trimesh 5.2 reads common accessors only (sparse ones become zeros, normalised ones integers) and supports neither
instancing nor a second uv set, so accessors are read here.
"""

import base64
import binascii
import json
import struct
import urllib.parse
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.errors import SceneError
from app.load import draco, meshopt

_TRIANGLES = 4
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942
_UNSIGNED_INT = 5125
_MAX_ZEROS = 2**26
_MAX_UNPACKED_BYTES = 2**30
_DRACO, _MESHOPT, _BASISU = "KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu"


class Entries(list[Any]):
    """An array that a file refers into: unlike those of a list, negative indices are as wrong as those past its end."""

    def __init__(self, name: str, entries: Iterable[Any]) -> None:
        super().__init__(entries)
        self._name = name

    def __getitem__(self, index: Any) -> Any:
        if not isinstance(index, slice) and not (isinstance(index, int) and 0 <= index < len(self)):
            raise IndexError(f"{self._name} has no entry {index!r}")
        return super().__getitem__(index)


class Codes(dict[Any, Any]):
    """What each value of a key stands for; another value than these is an error that names it."""

    def __init__(self, key: str, meanings: dict[Any, Any]) -> None:
        super().__init__(meanings)
        self._key = key

    def __missing__(self, value: Any) -> Any:
        raise ValueError(f"{self._key} {value!r} is none of {', '.join(map(str, self))}")


_COMPONENTS = Codes("componentType", {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32,
                                      5126: np.float32})
_WIDTHS = Codes("an accessor's type", {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16})


@dataclass(eq=False)
class GltfFile:
    """The JSON of a glTF file and its binary buffers, followed by what was unpacked from them."""

    path: Path
    json: dict[str, Any]
    buffers: Entries
    unpacked_bytes: int = 0

    def items(self, key: str) -> Entries:
        """A top-level array of the JSON, empty if missing."""
        return Entries(key, self.json.get(key, []))

    def view(self, index: int) -> bytes:
        """The bytes of a buffer view."""
        return self._slice(self.json["bufferViews"][index], f"buffer view {index}")

    def _slice(self, view: dict[str, Any], name: str) -> bytes:
        start = view.get("byteOffset", 0)
        data: bytes = self.buffers[view["buffer"]][start:start + view["byteLength"]]
        if start < 0 or len(data) != view["byteLength"]:
            raise ValueError(f"{name} reaches past the end of its buffer")
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
        if (rows < 0).any():
            raise ValueError("a sparse accessor has negative indices")
        values[rows[:, 0]] = _strided(self.view(what["bufferView"]), values.dtype, count, values.shape[1],
                                      what.get("byteOffset", 0), values.dtype.itemsize * values.shape[1])
        return values

    def unpack(self) -> None:
        """Replace all compressed buffer views, meshes and textures by plain ones."""
        for index, view in enumerate(self.items("bufferViews")):
            if _MESHOPT in view.get("extensions", {}):
                self._unpack_view(index, view["extensions"][_MESHOPT])
        for mesh in self.items("meshes"):
            for primitive in mesh["primitives"]:
                if _DRACO in primitive.get("extensions", {}):
                    self._unpack_primitive(primitive, primitive["extensions"][_DRACO])
        for texture in self.items("textures"):
            if _BASISU in texture.get("extensions", {}):
                texture.setdefault("source", texture["extensions"][_BASISU]["source"])

    def _unpack_view(self, index: int, spec: dict[str, Any]) -> None:
        data = meshopt.decode(self._slice(spec, f"compressed buffer view {index}"), spec["count"], spec["byteStride"],
                              spec["mode"], spec.get("filter", "NONE"))
        self.json["bufferViews"][index] |= {"buffer": self._add_buffer(data), "byteOffset": 0, "byteLength": len(data)}

    def _unpack_primitive(self, primitive: dict[str, Any], spec: dict[str, Any]) -> None:
        if "bufferView" in self.json["accessors"][primitive["attributes"]["POSITION"]]:
            return  # the file has the mesh without compression, too
        triangles, attributes = draco.decode(self.view(spec["bufferView"]))
        for name, unique_id in spec["attributes"].items():
            if unique_id not in attributes:
                raise ValueError(f"Draco data have no attribute {unique_id} for {name}")
            accessor = self.json["accessors"][primitive["attributes"][name]]
            values = attributes[unique_id].astype(_COMPONENTS[accessor["componentType"]])
            primitive["attributes"][name] = self._add_accessor(accessor, values)
        indices = {"componentType": _UNSIGNED_INT, "type": "SCALAR"}
        primitive |= {"indices": self._add_accessor(indices, triangles.reshape(-1, 1)), "mode": _TRIANGLES}

    def _add_accessor(self, like: dict[str, Any], values: NDArray[Any]) -> int:
        """Add an accessor of the same type as another one, with these values of shape (count, width)."""
        if values.shape[1] != _WIDTHS[like["type"]]:
            raise ValueError(f"Draco data have {values.shape[1]} components where {like['type']} is expected")
        view = {"buffer": self._add_buffer(values.tobytes()), "byteLength": values.nbytes}
        self.json["bufferViews"].append(view)
        self.json["accessors"].append(like | {"bufferView": len(self.json["bufferViews"]) - 1, "byteOffset": 0,
                                              "count": len(values)})
        return len(self.json["accessors"]) - 1

    def _add_buffer(self, data: bytes) -> int:
        self.buffers.append(data)
        self.unpacked_bytes += len(data)
        if self.unpacked_bytes > _MAX_UNPACKED_BYTES:
            raise ValueError("it unpacks to more than 1 GiB")
        return len(self.buffers) - 1


def open_gltf(path: Path) -> GltfFile:
    """Read a ``.gltf`` or ``.glb`` file and all its buffers, and unpack what is compressed.

    Raises
    ------
    SceneError
        When a buffer's file can't be read.
    MissingExtraError
        When a package that unpacks it is not installed.
    ValueError, KeyError, struct.error
        When the content is not valid glTF 2.
    """
    data = path.read_bytes()
    binary = b""
    if data[:4] == b"glTF":
        data, binary = _split_glb(data)
    elif path.suffix.lower() == ".glb" and data.strip() and not data.lstrip().startswith(b"{"):
        raise ValueError("it does not begin as a binary glTF file does")
    document = json.loads(data.decode("utf-8-sig"), object_hook=_with_checked_arrays)
    if not isinstance(document, dict) or "asset" not in document:
        raise ValueError("it has no glTF asset")
    version = str(document["asset"].get("version", ""))
    if not version.startswith("2"):
        raise ValueError(f"glTF version {version}; only version 2 is supported")
    buffers = [_buffer(spec, path, binary if index == 0 else b"")
               for index, spec in enumerate(document.get("buffers", []))]
    file = GltfFile(path, document, Entries("buffers", buffers))
    file.unpack()
    return file


def _with_checked_arrays(content: dict[str, Any]) -> dict[str, Any]:
    """A JSON object whose arrays of objects check the indices into them."""
    return {key: Entries(key, value) if isinstance(value, list) and value and isinstance(value[0], dict) else value
            for key, value in content.items()}


def _buffer(spec: dict[str, Any], path: Path, binary: bytes) -> bytes:
    """The bytes of a buffer; one that only describes what a compressed view becomes has none."""
    if spec.get("extensions", {}).get(_MESHOPT, {}).get("fallback"):
        return b""
    return _fetch(spec["uri"], path) if "uri" in spec else binary


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
    if _JSON_CHUNK not in chunks:
        raise ValueError("the GLB file has no JSON chunk")
    return chunks[_JSON_CHUNK], chunks.get(_BINARY_CHUNK, b"")


def _fetch(uri: str, beside: Path) -> bytes:
    if uri.startswith("data:"):
        try:
            return base64.b64decode(uri.split(",", 1)[1], validate=True)
        except (binascii.Error, IndexError) as error:
            raise ValueError("a data URI is not base64") from error
    file = beside.parent / urllib.parse.unquote(uri)
    try:
        if not file.exists() and (beside.parent / uri).exists():
            file = beside.parent / uri  # some exporters leave the percent signs of names as they are
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
