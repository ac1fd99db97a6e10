"""Open Image Denoise: path-traced light without most of its noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.extras import extra_module

F32 = NDArray[np.float32]


def denoise(light: F32, normal: F32, albedo: F32 | None = None) -> F32:
    """Light without most of its noise; never negative.

    Parameters
    ----------
    light : ndarray, float32, shape (H, W, 3)
        Linear, in W/(sr m²): radiance, or without ``albedo`` radiance / albedo.
    normal : ndarray, float32, shape (H, W, 3)
        World space.

    Raises
    ------
    MissingExtraError
        Without the package pyoidn.
    """
    run = extra_module("pyoidn", "export").denoise
    guide = np.ones_like(light) if albedo is None else np.clip(albedo, 0, 1)
    found: F32 = run(*map(np.ascontiguousarray, (light, guide, normal)), hdr=True)
    return np.maximum(found, 0)
