"""How much a surfel tells about a point nearby: the weight by which light is interpolated between surfels.

The logarithm of the weight is a sum of products of what is known of the point and what is known of the surfel, so all
weights together are one matrix product: the network's attention, and here the search for the nearest surfel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
Ints = NDArray[np.int64]

DISTANCE = 3.0  # weight of squared distance in radii of the surfel,
TURN = 8.0      # of 1 - cosine between the normals,
PLANE = 24.0    # and of the squared distance from the point's plane in radii
ROWS = 4096     # of the matrix that are worked out at once
# Points up to which no BLAS is asked: its threads spin for a while after a product, and slow the passes that follow.
FEW = 256


def keys(position: F32, normal: F32, radius: F32) -> F32:
    """What the kernel knows of surfels, shape (S, 18).

    Parameters
    ----------
    position, normal : ndarray, float32, shape (S, 3)
    radius : ndarray, float32, shape (S,)
        How far a surfel's light reaches, in the unit of the positions.
    """
    x, y, z = position.T
    s = 1 / radius[:, None] ** 2
    square = np.stack([x * x, y * y, z * z, x * y, x * z, y * z], axis=1)
    return np.concatenate([square * s, position * s, s, normal, square[:, :3].sum(axis=1, keepdims=True) * s,
                           position * s, s], axis=1).astype(np.float32)


def queries(position: F32, normal: F32) -> F32:
    """What the kernel knows of points, shape (N, 18); arguments of shape (N, 3)."""
    a, b, c = normal.T
    off = (position * normal).sum(axis=1, keepdims=True)
    twice = np.stack([a * a, b * b, c * c, 2 * a * b, 2 * a * c, 2 * b * c], axis=1)
    return np.concatenate([-PLANE * twice, 2 * PLANE * off * normal, -PLANE * off**2, TURN * normal,
                           np.full_like(off, -DISTANCE), 2 * DISTANCE * position,
                           -DISTANCE * (position**2).sum(axis=1, keepdims=True)], axis=1).astype(np.float32)


def nearest(key: F32, position: F32, normal: F32) -> Ints:
    """The surfel of ``keys`` that weighs most at each point, shape (N,)."""
    query = queries(position, normal)
    if len(query) <= FEW:
        return np.asarray(np.einsum("nc,sc->ns", query, key).argmax(axis=1))
    return np.concatenate([(query[i:i + ROWS] @ key.T).argmax(axis=1) for i in range(0, len(query), ROWS)])
