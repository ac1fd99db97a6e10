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
PLANE_WEIGHT = 24.0    # and the squared distance of the surfel from the point's plane in radii.
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


def nearest(key: F32, position: F32, normal: F32) -> Ints:
    """Index of the surfel in ``keys`` that has the largest weight at each point, shape (N,)."""
    query = queries(position, normal)
    if len(query) <= MAX_EINSUM_QUERIES:
        return np.asarray(np.einsum("nc,sc->ns", query, key).argmax(axis=1))
    return np.concatenate([(query[i:i + BLOCK] @ key.T).argmax(axis=1) for i in range(0, len(query), BLOCK)])
