"""The weights with which light is interpolated between surfels.

The logarithm of a weight is a dot product of a query, which describes the point, and a key, which describes the surfel.
All weights together are therefore one matrix product: the network's attention, and here the search for the nearest
surfel.
"""

import numpy as np

from app.arrays import F32, Ints

# A weight's exponent is minus the sum of these factors times
DISTANCE_WEIGHT = 3.0  # the squared distance in radii of the surfel,
NORMAL_WEIGHT = 8.0    # 1 - the cosine between the normals,
PLANE_WEIGHT = 24.0    # the squared distance of the surfel from the point's plane in radii,
CLIP_WEIGHT = 200.0    # and how far the point is beyond the surfel's clip plane, in radii,
CLIP_MARGIN = 0.02     # less this: points on the wall itself are not beyond it.
BLOCK = 4096           # queries multiplied at once
# Up to this many queries avoid BLAS, whose threads spin for a while after a product and slow down the next passes.
MAX_EINSUM_QUERIES = 256


def keys(position: F32, normal: F32, radius: F32) -> F32:
    """The kernel's keys of surfels, shape (S, 18).

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
    """The kernel's queries of points, shape (N, 18); arguments of shape (N, 3)."""
    a, b, c = normal.T
    off = (position * normal).sum(axis=1, keepdims=True)
    twice = np.stack([a * a, b * b, c * c, 2 * a * b, 2 * a * c, 2 * b * c], axis=1)
    return np.concatenate([-PLANE_WEIGHT * twice, 2 * PLANE_WEIGHT * off * normal, -PLANE_WEIGHT * off**2,
                           NORMAL_WEIGHT * normal, np.full_like(off, -DISTANCE_WEIGHT),
                           2 * DISTANCE_WEIGHT * position,
                           -DISTANCE_WEIGHT * (position**2).sum(axis=1, keepdims=True)], axis=1).astype(np.float32)


def nearest(key: F32, clip: F32, position: F32, normal: F32) -> Ints:
    """Index of the surfel that has the largest weight at each point, shape (N,).

    Parameters
    ----------
    key, clip : ndarray, float32, shapes (S, 18) and (S, 4)
        ``keys`` and ``clip_keys`` of the surfels.
    """
    found = _largest(queries(position, normal), key)
    at = np.concatenate([position, np.ones_like(position[:, :1])], axis=1)
    clipped = np.flatnonzero((clip[found] * at).sum(axis=1) < 0)
    for start in range(0, len(clipped), BLOCK):
        rows = clipped[start:start + BLOCK]
        exponent = queries(position[rows], normal[rows]) @ key.T + np.minimum(at[rows] @ clip.T, 0)
        found[rows] = exponent.argmax(axis=1)
    return found


def clip_keys(plane: F32, radius: F32) -> F32:
    """The negative part of their product with (x, 1) is the exponent at x that clip planes add, shape (S, 4)."""
    return -CLIP_WEIGHT * (plane / radius[:, None] - np.array([0, 0, 0, CLIP_MARGIN], np.float32))


def _largest(query: F32, key: F32) -> Ints:
    if len(query) <= MAX_EINSUM_QUERIES:
        return np.asarray(np.einsum("nc,sc->ns", query, key).argmax(axis=1))
    return np.concatenate([(query[i:i + BLOCK] @ key.T).argmax(axis=1) for i in range(0, len(query), BLOCK)])
