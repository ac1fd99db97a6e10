"""EXT_meshopt_compression: compressed buffer views -> their bytes.

Bitstreams and filters as in the extension's specification, version 0
(https://github.com/KhronosGroup/glTF/tree/main/extensions/2.0/Vendor/EXT_meshopt_compression).
"""

import numpy as np

from app.arrays import F64, Bytes, Ints

_ATTRIBUTES, _TRIANGLES, _INDICES = 0xA0, 0xE1, 0xD1  # first byte of each bitstream
_GROUP = 16                   # elements that share an encoding of their deltas
_MAX_BLOCK_BYTES, _MAX_BLOCK = 8192, 256
_MIN_TAIL = 32
_MAX_GROUP_BYTES = 24
_CHUNK = 2**16                # groups decoded at once
_MAX_EXPANSION = 64           # bytes of attributes in a byte of the stream: 2 bits stand for 16 equal bytes


def decode(data: bytes, count: int, stride: int, mode: str, filter_name: str = "NONE") -> bytes:
    """Decode ``count`` elements of ``stride`` bytes.

    Raises
    ------
    ValueError
        When the stream is corrupt or its description invalid; memory is bounded by a multiple of the stream's length.
    """
    if not 0 <= count * stride <= _MAX_EXPANSION * len(data):
        raise ValueError(f"{len(data)} bytes of meshopt data are too few for {count} elements")
    if mode == "ATTRIBUTES" and 0 < stride <= 256 and stride % 4 == 0:
        values = decode_attributes(data, count, stride)
        return _filtered(values, filter_name)
    if mode in ("TRIANGLES", "INDICES") and stride in (2, 4) and filter_name == "NONE":
        indices = (decode_triangles if mode == "TRIANGLES" else decode_indices)(data, count)
        return indices.astype("<u2" if stride == 2 else "<u4").tobytes()
    raise ValueError(f"meshopt mode {mode!r} with filter {filter_name!r} and {stride} bytes per element is unknown")


def decode_attributes(data: bytes, count: int, stride: int) -> Bytes:
    """Mode 0: elements as bytes, uint8, shape (count, stride), each the sum of all deltas before it."""
    end = len(data) - max(stride, _MIN_TAIL)
    if end < 1 or data[0] != _ATTRIBUTES:
        raise ValueError("not a meshopt stream of attributes")
    stream = data[:end] + bytes(_MAX_BLOCK // _GROUP * _MAX_GROUP_BYTES + _MAX_BLOCK)  # so that a block never overruns
    total, rows, positions, modes = _locate_groups(stream, end, count, stride)
    groups = np.zeros((total, _GROUP), np.uint8)
    for i in range(0, len(rows), _CHUNK):
        part = slice(i, i + _CHUNK)
        groups[rows[part]] = _read_groups(np.frombuffer(stream, np.uint8), positions[part], modes[part])
    block = _block_elements(stride)
    whole = count // block * stride * (block // _GROUP)
    deltas = np.concatenate([
        groups[:whole].reshape(-1, stride, block).swapaxes(0, 1).reshape(stride, -1),
        groups[whole:].reshape(stride, -1)], axis=1)[:, :count]
    baseline = np.frombuffer(data[-stride:], np.uint8)
    return np.ascontiguousarray((np.cumsum(deltas, axis=1, dtype=np.uint8) + baseline[:, None]).T)


def _block_elements(stride: int) -> int:
    return min(_MAX_BLOCK_BYTES // stride // _GROUP * _GROUP, _MAX_BLOCK)


def _locate_groups(stream: bytes, end: int, count: int, stride: int) -> tuple[int, Ints, Ints, Bytes]:
    """Number of groups of 16 deltas, by block, byte of an element and group; index, position and encoding of some.

    All deltas of the others are 0.
    """
    values = np.frombuffer(stream, np.uint8)
    pairs = sum((values >> shift & 3) == 3 for shift in (0, 2, 4, 6))
    nibbles = sum((values >> shift & 15) == 15 for shift in (0, 4))
    sizes: tuple[list[int], ...] = ([], _sizes(pairs, 4), _sizes(nibbles, 8), [_GROUP] * len(stream))
    rows, positions, modes = [], [], []
    total, at, block = 0, 1, _block_elements(stride)
    for start in range(0, count, block):
        groups = -(-min(block, count - start) // _GROUP)
        for _ in range(stride):
            header = stream[at:at + (groups + 3) // 4]
            at += len(header)
            if any(header):
                for group in range(groups):
                    mode = header[group >> 2] >> (group & 3) * 2 & 3
                    if mode:
                        rows.append(total + group)
                        positions.append(at)
                        modes.append(mode)
                        at += sizes[mode][at]
            if at > end:
                raise ValueError("meshopt data end too early")
            total += groups
    if at != end:
        raise ValueError("meshopt data continue behind their last element")
    return total, np.array(rows, np.int64), np.array(positions, np.int64), np.array(modes, np.uint8)


def _sizes(sentinels: Ints, length: int) -> list[int]:
    """Length of a group with codes in ``length`` bytes, by where it begins: each sentinel adds a byte."""
    total = np.concatenate([[0], np.cumsum(sentinels)])
    return (length + total[length:] - total[:-length]).tolist() + [0] * (length - 1)


def _read_groups(stream: Bytes, positions: Ints, modes: Bytes) -> Bytes:
    """Deltas of groups, uint8 modulo 256, shape (G, 16)."""
    codes = np.zeros((len(positions), _GROUP), np.uint8)
    for mode, bits in ((1, 2), (2, 4)):
        rows = np.flatnonzero(modes == mode)
        packed = stream[positions[rows, None] + np.arange(_GROUP * bits // 8)]
        shifts = np.arange(8 - bits, -1, -bits, dtype=np.uint8)
        short = (packed[:, :, None] >> shifts & (2**bits - 1)).reshape(-1, _GROUP)
        is_sentinel = short == 2**bits - 1
        literal = (positions[rows] + _GROUP * bits // 8)[:, None] + np.cumsum(is_sentinel, axis=1) - 1
        codes[rows] = np.where(is_sentinel, stream[literal], short)
    rows = np.flatnonzero(modes == 3)
    codes[rows] = stream[positions[rows, None] + np.arange(_GROUP)]
    return (codes >> 1) ^ np.negative(codes & 1)


class _Cursor:
    """Reads numbers from a stream."""

    def __init__(self, data: bytes, at: int, end: int) -> None:
        self.data, self.at, self.end = data, at, end

    def byte(self) -> int:
        if self.at >= self.end:
            raise ValueError("meshopt data end too early")
        self.at += 1
        return self.data[self.at - 1]

    def varint(self) -> int:
        """Read an unsigned LEB128 number of at most 32 bits."""
        value = 0
        for shift in range(0, 35, 7):
            byte = self.byte()
            value |= (byte & 127) << shift
            if byte < 128:
                break
        return value & 0xFFFFFFFF


def _unzigzag(value: int) -> int:
    return ~(value >> 1) if value & 1 else value >> 1


def decode_triangles(data: bytes, count: int) -> Ints:
    """Mode 1: indices of a triangle list, int64, shape (count,)."""
    triangles, end = count // 3, len(data) - 16
    if count % 3 or end < 1 + triangles or data[0] != _TRIANGLES:
        raise ValueError("not a meshopt stream of triangles")
    table = data[end:]
    extra = _Cursor(data, 1 + triangles, end)
    edges, vertices = [(0, 0)] * 16, [0] * 16  # the newest is last
    newest, last = 0, 0
    indices: list[int] = []

    def vertex(code: int) -> int:
        """One corner: a new vertex, one met before, or one given as a difference."""
        nonlocal newest, last
        if 0 < code < 15:
            return vertices[-code]
        if code == 0:
            newest += 1
            return newest - 1
        last = last + _unzigzag(extra.varint()) & 0xFFFFFFFF
        return last

    for code in data[1:1 + triangles]:
        edge, third = code >> 4, code & 15
        if edge < 15:
            a, b = edges[-1 - edge]
            if third in (13, 14):
                c = last = last + (1 if third == 14 else -1) & 0xFFFFFFFF
            else:
                c = vertices[-1 - third] if 0 < third < 13 else vertex(third)
            pushed = [] if 0 < third < 13 else [c]
            edges = [*edges[2:], (c, b), (a, c)]
        else:
            corners = table[third] if third < 14 else extra.byte()
            if third >= 14 and corners == 0:
                newest = 0
            a = vertex(0 if third < 15 else 15)
            b, c = vertex(corners >> 4), vertex(corners & 15)
            pushed = [a] + [v for v, k in ((b, corners >> 4), (c, corners & 15)) if k in (0, 15)]
            edges = [*edges[3:], (b, a), (c, b), (a, c)]
        if pushed:
            vertices = [*vertices[len(pushed):], *pushed]
        indices += (a, b, c)
    if extra.at != end:
        raise ValueError("meshopt data continue behind their last triangle")
    return np.array(indices, np.int64)


def decode_indices(data: bytes, count: int) -> Ints:
    """Mode 2: indices in any order, int64, shape (count,)."""
    end = len(data) - 4
    if end < 1 + count or data[0] != _INDICES:
        raise ValueError("not a meshopt stream of indices")
    stream, last = _Cursor(data, 1, end), [0, 0]
    indices = np.zeros(count, np.int64)
    for i in range(count):
        value = stream.varint()
        indices[i] = last[value & 1] = last[value & 1] + _unzigzag(value >> 1) & 0xFFFFFFFF
    if stream.at != end:
        raise ValueError("meshopt data continue behind their last index")
    return indices


def _filtered(values: Bytes, name: str) -> bytes:
    """Elements after their filter."""
    stride = values.shape[1]
    if name == "NONE":
        return values.tobytes()
    if name == "OCTAHEDRAL" and stride in (4, 8):
        return _octahedral(values.view(f"<i{stride // 4}")).tobytes()
    if name == "QUATERNION" and stride == 8:
        return _quaternion(values.view("<i2")).tobytes()
    if name == "EXPONENTIAL":
        bits = values.view("<i4")
        return np.ldexp((bits << 8 >> 8).astype(np.float32), bits >> 24).astype("<f4").tobytes()
    raise ValueError(f"meshopt filter {name!r} with {stride} bytes per element is unknown")


def _octahedral(codes: Ints) -> Ints:
    """Unit vectors as normalised integers of the same type, shape (N, 4); the fourth component is kept."""
    x, y = (codes[:, i] / codes[:, 2].astype(np.float64) for i in (0, 1))
    z = 1.0 - np.abs(x) - np.abs(y)
    below = np.minimum(z, 0.0)
    vectors = np.stack([x - np.copysign(below, x), y - np.copysign(below, y), z], axis=1)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.concatenate([_to_integers(vectors, codes.dtype), codes[:, 3:]], axis=1)


def _quaternion(codes: Ints) -> Ints:
    """Quaternions as normalised 16-bit integers, shape (N, 4), from all components but the largest."""
    scale = (codes[:, 3] | 3).astype(np.float64) * np.sqrt(2.0)
    small = codes[:, :3] / scale[:, None]
    largest = np.sqrt(np.maximum(1.0 - (small**2).sum(axis=1), 0.0))
    places = ((codes[:, 3:] & 3) + np.array([1, 2, 3, 0])) % 4
    values = np.zeros(codes.shape, codes.dtype)
    np.put_along_axis(values, places.astype(np.int64),
                      _to_integers(np.concatenate([small, largest[:, None]], axis=1), codes.dtype), axis=1)
    return values


def _to_integers(values: F64, dtype: np.dtype[np.integer]) -> Ints:
    largest = np.iinfo(dtype).max
    return np.rint(np.nan_to_num(values).clip(-1, 1) * largest).astype(dtype)
