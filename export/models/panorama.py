"""Six views around the camera as one picture, as ``shaders/include/panorama.glsl`` merges them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.math3d import cube_rotations


def merged(cube: NDArray[Any]) -> NDArray[Any]:
    """The panorama, shape (C, 2 n, 4 n), of a cube, shape (C, 6, n, n); top row first, n even."""
    n = cube.shape[-1]
    front, back, left, right, up, down = np.moveaxis(cube, 1, 0)
    middle = np.concatenate([back[..., n // 2:], left, front, right, back[..., :n // 2]], axis=-1)
    # Rows are counted from below on the GPU, so the lower one of each two is picked.
    caps = [np.repeat(view[:, 1::2], 4, axis=-1) for view in (up, down)]
    return np.concatenate([caps[0], middle, caps[1]], axis=1)


def directions(height: int) -> NDArray[np.float64]:
    """From the camera to the middles of a panorama's texels, unit vectors in its space, shape (3, height, 2 height)."""
    n = height // 2
    at = (2 * np.arange(n) + 1) / n - 1
    x, y = np.meshgrid(at, -at)
    view = np.stack([x, y, -np.ones_like(x)], -1) / np.sqrt(x**2 + y**2 + 1)[..., None]
    return merged(np.stack([np.moveaxis(view @ rotation, -1, 0) for rotation in cube_rotations()], axis=1))


def solid_angles(height: int) -> NDArray[np.float64]:
    """What each texel of a panorama stands for, shape (height, 2 height), in sr; 4 π together.

    Units: half the edge of a view, whose texels lie at distance 1 along its axis.
    """
    n = height // 2
    at = (2 * np.arange(n) + 1) / n - 1
    view = (1 + at[:, None]**2 + at**2)**-1.5
    found = merged(np.broadcast_to(view, (1, 6, n, n)))[0]
    for cap in (found[:n // 2], found[n // 2 + n:]):
        cap *= 2 / 4  # two rows of a view and a quarter of a column
    return found * (4 * np.pi / found.sum())
