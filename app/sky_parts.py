"""Counts of where rays have met the environment, in parts of the unit square that is spread over its light."""

import numpy as np

from app.arrays import F32, Ints

PARTS = 32  # along each edge of the square


def part_of(at: F32) -> Ints:
    """The part that points of the unit square, shape (N, 2), are in."""
    x, y = (np.minimum((axis * np.float32(PARTS)).astype(np.int64), PARTS - 1) for axis in at.T)
    return y * PARTS + x


def blur_parts(light: F32) -> F32:
    """Light of parts, shape (N, PARTS²), shared with those around: a window moves through them from point to point."""
    rows = np.pad(light.reshape(-1, PARTS, PARTS), [(0, 0), (1, 1), (0, 0)], mode="edge")
    light = rows[:, :-2] + 2 * rows[:, 1:-1] + rows[:, 2:]
    columns = np.pad(light, [(0, 0), (0, 0), (1, 1)], mode="wrap")
    light = (columns[..., :-2] + 2 * columns[..., 1:-1] + columns[..., 2:]) / np.float32(16)
    return light.reshape(len(light), PARTS * PARTS)
