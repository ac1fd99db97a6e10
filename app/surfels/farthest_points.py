"""Choose few points that stand for many."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
Ints = NDArray[np.int64]


def farthest(points: F32, count: int) -> Ints:
    """Indices of ``count`` points, each the farthest from those before (Gonzalez 1985); fewer when there are fewer.

    Parameters
    ----------
    points : ndarray, float32, shape (N, D)
    """
    points, square = _centred(points)
    distance = np.full(len(points), np.inf, np.float32)
    chosen: list[int] = []
    index = 0
    for _ in range(min(count, len(points))):
        chosen.append(index)
        np.minimum(distance, square - 2 * (points @ points[index]) + square[index], out=distance)
        distance[index] = -np.inf
        index = int(distance.argmax())
    return np.array(chosen, np.int64)


def neighbour_distance(points: F32, rank: int) -> F32:
    """Distance of each point to its ``rank``-th neighbour (1: the nearest), shape (N,); infinite without one."""
    found = np.full(len(points), np.inf, np.float32)
    if len(points) <= rank:
        return found
    points, square = _centred(points)
    for start in range(0, len(points), 1024):
        rows = slice(start, start + 1024)
        distance = square[rows, None] + square - 2 * (points[rows] @ points.T)
        found[rows] = np.sqrt(np.maximum(np.partition(distance, rank, axis=1)[:, rank], 0))
    return found


def _centred(points: F32) -> tuple[F32, F32]:
    """Points around their mean, and squared lengths: differences of those are imprecise far from the origin."""
    around = points - points.mean(axis=0) if len(points) else points
    return around, (around**2).sum(axis=1)
