"""The weights with which light is interpolated between surfels.

The logarithm of a weight is a dot product of a query, which describes the point, and a key, which describes the surfel.
All weights together are therefore one matrix product, the network's attention.
"""

import numpy as np

from app.arrays import F32

# A weight's exponent is minus the sum of these factors times
DISTANCE_WEIGHT = 3.0  # the squared distance in radii of the surfel,
NORMAL_WEIGHT = 8.0    # 1 - the cosine between the normals,
PLANE_WEIGHT = 24.0    # the squared distance of the surfel from the point's plane in radii,
CLIP_WEIGHT = 200.0    # and how far the point is beyond the surfel's clip plane, in radii,
CLIP_MARGIN = 0.02     # less this: points on the wall itself are not beyond it.

CENTER, INVERSE_SQUARE = slice(14, 17), 17  # of a key: the surfel's position times the next, and 1 / radius²


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


def clip_keys(plane: F32, radius: F32) -> F32:
    """The negative part of their product with (x, 1) is the exponent at x that clip planes add, shape (S, 4)."""
    return -CLIP_WEIGHT * (plane / radius[:, None] - np.array([0, 0, 0, CLIP_MARGIN], np.float32))
