"""Which texels of an image the renderer picks for a coarser grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def picked(size: tuple[int, int], grid: tuple[int, int]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the image's texels that stand for the grid's, as ``shaders/include/nearest_texel.glsl`` picks."""
    (w, h), (columns, rows) = size, grid
    x = np.floor((np.arange(columns) + 0.5) * (w / columns))
    y = h - 1 - np.floor((np.arange(rows)[::-1] + 0.5) * (h / rows))  # the shader's rows begin at the bottom
    return y.astype(np.intp), x.astype(np.intp)
