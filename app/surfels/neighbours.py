"""The surfel with the largest weight at each of many points, without a product of all points with all surfels.

The distance alone bounds a weight: its exponent is at most ``NORMAL_WEIGHT`` less ``DISTANCE_WEIGHT`` times the squared
distance in radii of the surfel. Points are sorted along a space-filling curve (Morton 1966), and each group of them is
multiplied only with the surfels that the bound doesn't exclude. Points for which these don't suffice are searched again
with a wider bound, so the result is that of the whole product.
"""

import numpy as np
from numpy.typing import NDArray

from app.arrays import F32, Ints
from app.math3d import row_blocks
from app.surfels import kernel

# Nine of ten points have a surfel whose exponent is at most this much below its maximum, and nearly all one within 8.
BOUNDS = (1.0, 8.0, np.inf)
MIN_GROUP, MAX_GROUP = 32, 64  # points
BLOCK = 64                     # groups for which surfels are selected at once
AXIS_BITS = 16                 # of a position on the curve


def nearest(key: F32, clip: F32, position: F32, normal: F32) -> Ints:
    """Index of the surfel that has the largest weight at each point, shape (N,).

    Parameters
    ----------
    key, clip : ndarray, float32, shapes (S, 18) and (S, 4)
        ``keys`` and ``clip_keys`` of the surfels.
    position, normal : ndarray, float32, shape (N, 3)
        In the space of the keys.
    """
    surfel = np.zeros(len(position), np.int64)
    left = np.arange(len(position))
    for bound in BOUNDS:
        surfel[left], exponent = _search(key, clip, position.take(left, axis=0), normal.take(left, axis=0), bound)
        left = left[exponent < kernel.NORMAL_WEIGHT - bound]
    return surfel


def _search(key: F32, clip: F32, position: F32, normal: F32, bound: float) -> tuple[Ints, F32]:
    """The surfel with the largest exponent at each point, and the exponent, shape (N,).

    Only surfels that may have an exponent of at least ``NORMAL_WEIGHT`` - ``bound`` are looked at.
    """
    surfel, largest = np.zeros(len(position), np.int64), np.full(len(position), -np.inf, np.float32)
    size = int(np.clip(len(position) // (2 * len(key)), MIN_GROUP, MAX_GROUP))
    inverse = key[:, kernel.INVERSE_SQUARE]
    center, reach = key[:, kernel.CENTER] / inverse[:, None], np.float32(bound / kernel.DISTANCE_WEIGHT) / inverse
    order = _sort_along_curve(position, normal)
    for start in range(0, len(order), BLOCK * size):
        rows = order[start:start + BLOCK * size]
        points = position.take(rows, axis=0)
        query = kernel.queries(points, normal.take(rows, axis=0))
        homogeneous = np.concatenate([points, np.ones_like(points[:, :1])], axis=1)
        first = np.arange(0, len(rows), size)
        low, high = np.minimum.reduceat(points, first), np.maximum.reduceat(points, first)
        near = np.flatnonzero(_square_distance(center, low.min(axis=0), high.max(axis=0)) <= reach)
        is_near = _square_distance(center[near], low[:, None], high[:, None]) <= reach[near]
        for begin, chosen in zip(first.tolist(), is_near, strict=True):
            candidates = near[chosen]
            if not len(candidates):
                continue
            keys, clips = key.take(candidates, axis=0).T, clip.take(candidates, axis=0).T
            group = rows[begin:begin + size]
            for block in row_blocks(len(group), keys.size):
                at = slice(begin + block.start, begin + block.stop)
                exponent = query[at] @ keys + np.minimum(homogeneous[at] @ clips, 0)
                surfel[group[block]] = candidates[exponent.argmax(axis=1)]
                largest[group[block]] = exponent.max(axis=1)
    return surfel, largest


def _square_distance(points: F32, low: F32, high: F32) -> F32:
    """Squared distances of points, shape (N, 3), from boxes, shape (3,) or (B, 1, 3); shape (N,) or (B, N)."""
    away = (np.maximum(np.maximum(low[..., a] - points[:, a], points[:, a] - high[..., a]), 0) for a in range(3))
    x, y, z = away
    return np.asarray(x * x + y * y + z * z)


def _sort_along_curve(position: F32, normal: F32) -> Ints:
    """Indices of points, shape (N,), in an order that keeps together what is close and faces the same side."""
    if not len(position):
        return np.zeros(0, np.int64)
    low = position.min(axis=0)
    scale = np.float32(2**AXIS_BITS - 1) / np.maximum((position - low).max(), np.float32(1e-30))
    bits = ((position - low) * scale).astype(np.uint64)
    for shift, mask in ((16, 0xFF0000FF), (8, 0xF00F00F00F), (4, 0xC30C30C30C3), (2, 0x249249249249)):
        bits = (bits | bits << np.uint64(shift)) & np.uint64(mask)
    axis = np.abs(normal).argmax(axis=1)
    side: NDArray[np.uint64] = (2 * axis + (normal[np.arange(len(normal)), axis] < 0)).astype(np.uint64)
    code = bits[:, 0] | bits[:, 1] << np.uint64(1) | bits[:, 2] << np.uint64(2) | side << np.uint64(3 * AXIS_BITS)
    return np.asarray(code.argsort())
