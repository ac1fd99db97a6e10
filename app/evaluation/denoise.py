"""Open Image Denoise: path-traced light without most of its noise."""

from __future__ import annotations

from importlib import metadata

import numpy as np
from numpy.typing import NDArray

from app.extras import extra_module

F32 = NDArray[np.float32]
PACKAGE, EXTRA = "pyoidn", "export"


def denoiser_version() -> str:
    """Of the package; what is denoised depends on it.

    Raises
    ------
    MissingExtraError
        When there is nothing to denoise with.
    """
    extra_module(PACKAGE, EXTRA)
    return metadata.version(PACKAGE)


def denoise(light: F32, normal: F32, albedo: F32 | None = None) -> F32:
    """Light without most of its noise; never negative, and 0 where there is no surface.

    Parameters
    ----------
    light : ndarray, float32, shape (H, W, 3)
        Linear, in W/(sr m²): radiance, or without ``albedo`` radiance / albedo.
    normal : ndarray, float32, shape (H, W, 3)
        World space; 0 where there is no surface.
    albedo : ndarray, float32, shape (H, W, 3), or None
        Guides as well, where light is not divided by it.

    Raises
    ------
    MissingExtraError
        When there is nothing to denoise with.
    """
    run = extra_module(PACKAGE, EXTRA).denoise
    guide = np.ones_like(light) if albedo is None else np.clip(albedo, 0, 1)
    found: F32 = run(*map(np.ascontiguousarray, (light, guide, normal)), hdr=True)
    return np.where(normal.any(axis=-1, keepdims=True), np.maximum(found, 0), np.float32(0))
