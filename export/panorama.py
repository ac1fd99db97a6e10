"""Six views around the camera as one picture, as ``shaders/include/panorama.glsl`` merges them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def merged(cube: NDArray[Any]) -> NDArray[Any]:
    """The panorama, shape (C, 2 n, 4 n), of a cube, shape (C, 6, n, n); top row first, n even."""
    n = cube.shape[-1]
    front, back, left, right, up, down = np.moveaxis(cube, 1, 0)
    middle = np.concatenate([back[..., n // 2:], left, front, right, back[..., :n // 2]], axis=-1)
    # Rows are counted from below on the GPU, so the lower one of each two is picked.
    caps = [np.repeat(view[:, 1::2], 4, axis=-1) for view in (up, down)]
    return np.concatenate([caps[0], middle, caps[1]], axis=1)
