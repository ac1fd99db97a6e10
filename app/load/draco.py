"""KHR_draco_mesh_compression: a Draco stream -> triangles and vertex attributes, by DracoPy."""

import struct
from collections.abc import Iterator
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.extras import extra_module

_SEQUENTIAL = 0         # the encoding method without a traversal
_HAS_METADATA = 0x8000
_MAX_PER_BYTE = 256     # faces or vertices that a byte of the stream may stand for; a flat grid has about 10


def decode(data: bytes) -> tuple[NDArray[np.uint32], dict[int, NDArray[Any]]]:
    """Decode a mesh.

    Returns
    -------
    triangles : ndarray, uint32, shape (T, 3)
    attributes : dict of int to ndarray
        Values by the attribute's unique id, shapes (V, C).

    Raises
    ------
    MissingExtraError
        When DracoPy is not installed.
    ValueError
        When the stream is corrupt, or announces more than it can hold.
    """
    decoder = extra_module("DracoPy", "assets")
    try:
        if max(_announced_counts(data)) > _MAX_PER_BYTE * len(data):
            raise ValueError("it announces more faces or vertices than it can hold")
        mesh = decoder.decode(data)
        return mesh.faces, {a["unique_id"]: a["data"] for a in mesh.attributes}
    except Exception as error:  # a short header raises StopIteration, damaged data an exception of the decoder's own
        raise ValueError(f"{len(data)} bytes of Draco data can't be decoded: {error}") from error


def _announced_counts(data: bytes) -> tuple[int, int]:
    """Two counts that the decoder allocates memory for before it reads on: of faces and of vertices, in either order.

    https://google.github.io/draco/spec/, sections 4 to 7
    """
    magic, major, minor, _, method, flags = struct.unpack_from("<5sBBBBH", data)
    if magic != b"DRACO" or (major, minor) != (2, 2):
        raise ValueError("it is not of version 2.2")
    stream = iter(data[struct.calcsize("<5sBBBBH"):])
    if flags & _HAS_METADATA:
        for _ in range(_varint(stream)):
            _varint(stream)
            _skip_metadata(stream)
        _skip_metadata(stream)
    if method != _SEQUENTIAL:
        next(stream)
    return _varint(stream), _varint(stream)


def _skip_metadata(stream: Iterator[int]) -> None:
    """Skip names and values of an element, then its children, each of which has a name before it."""
    elements = 1
    while elements:
        for _ in range(_varint(stream)):
            _skip(stream, next(stream))
            _skip(stream, _varint(stream))
        children = _varint(stream)
        elements += children - 1
        if elements:
            _skip(stream, next(stream))


def _skip(stream: Iterator[int], count: int) -> None:
    next(islice(stream, count, count), None)


def _varint(stream: Iterator[int]) -> int:
    """Read an unsigned LEB128 number."""
    value = shift = 0
    while (byte := next(stream)) >= 128:
        value |= (byte & 127) << shift
        shift += 7
    return value | byte << shift
