"""Farthest-point sampling, and distances to neighbours."""

import numpy as np

from app.arrays import F32, Ints
from app.math3d import row_blocks


def sample_farthest(points: F32, count: int) -> Ints:
    """Indices of up to ``count`` points, each the farthest from those before it (Gonzalez 1985).

    Parameters
    ----------
    points : ndarray, float32, shape (N, D)
    """
    columns = np.ascontiguousarray(points.T)
    distance = np.full(len(points), np.inf, np.float32)
    square, along = np.empty_like(distance), np.empty_like(distance)
    chosen: list[int] = []
    index = 0
    for _ in range(min(count, len(points))):
        chosen.append(index)
        # Without a matrix product: on another CPU it would round otherwise, and each choice decides all later ones.
        square[:] = 0
        for column in columns:
            np.subtract(column, column[index], out=along)
            square += np.square(along, out=along)
        np.minimum(distance, square, out=distance)
        distance[index] = -np.inf
        index = int(distance.argmax())
    return np.array(chosen, np.int64)


def neighbour_distance(points: F32, rank: int) -> F32:
    """Distance of each point to its ``rank``-th nearest neighbour, from 1, shape (N,); infinite if it has fewer."""
    nearest = np.full(len(points), np.inf, np.float32)
    if len(points) <= rank:
        return nearest
    points, square = _center(points)
    for rows in row_blocks(len(points), points.size):
        distance = square[rows, None] + square - 2 * (points[rows] @ points.T)
        nearest[rows] = np.sqrt(np.maximum(np.partition(distance, rank, axis=1)[:, rank], 0))
    return nearest


def _center(points: F32) -> tuple[F32, F32]:
    """Points relative to their mean, and their squared lengths, whose differences are imprecise far from the origin."""
    centered = points - points.mean(axis=0) if len(points) else points
    return centered, (centered**2).sum(axis=1)
