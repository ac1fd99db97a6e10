"""Bounding volumes of triangles as a complete binary tree, which shaders walk without pointers.

Nodes are numbered as in a heap: the children of node i are 2 i and 2 i + 1, the root is 1. Triangles are split at the
median of their centres along the longest edge of what these fill.
"""

from dataclasses import dataclass

import numpy as np

from app.arrays import F32, Ints

LEAF = 4  # triangles of a leaf


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """Bounding volumes of N leaves.

    Attributes
    ----------
    order : ndarray of int, shape (N · LEAF,)
        The triangles of the leaves, one leaf after the other. Some are listed twice, to fill all leaves.
    bounds : ndarray, float32, shape (2 N, 2, 3)
        Lowest and highest corner of each node's box; the first row is unused, and leaves are the last N.
    """

    order: Ints
    bounds: F32

    @property
    def leaves(self) -> int:
        """How many leaves there are, a power of 2."""
        return len(self.bounds) // 2


def build_hierarchy(corners: F32) -> Hierarchy:
    """The hierarchy of triangles with ``corners``, float32, shape (T, 3, 3), of which there is at least one."""
    count = len(corners)
    leaves = 1 << max(0, (-(-count // LEAF) - 1).bit_length())
    order: Ints = np.arange(leaves * LEAF) * count // (leaves * LEAF)
    low, high = corners.min(axis=1), corners.max(axis=1)
    center = (low + high) / 2
    half = leaves * LEAF // 2
    while half >= LEAF:
        order = order.reshape(-1, 2 * half)
        at = center[order]
        axis = np.argmax(at.max(axis=1) - at.min(axis=1), axis=1)
        along = np.take_along_axis(at, axis[:, None, None], axis=2)[..., 0]
        order = np.take_along_axis(order, np.argpartition(along, half, axis=1), axis=1)
        half //= 2
    order = order.ravel()
    bounds = np.zeros((2 * leaves, 2, 3), np.float32)
    bounds[leaves:, 0] = low[order].reshape(leaves, LEAF, 3).min(axis=1)
    bounds[leaves:, 1] = high[order].reshape(leaves, LEAF, 3).max(axis=1)
    level = leaves
    while level > 1:
        pairs = bounds[level:2 * level].reshape(level // 2, 2, 2, 3)
        level //= 2
        bounds[level:2 * level, 0], bounds[level:2 * level, 1] = pairs[:, :, 0].min(axis=1), pairs[:, :, 1].max(axis=1)
    return Hierarchy(order, bounds)
