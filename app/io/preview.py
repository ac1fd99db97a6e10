"""Any AOV as an 8-bit picture."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.io.image import F32, srgb_encode, to_8bit

Values = NDArray[np.floating[Any]]

RATIOS = ("albedo", "roughness")


def preview(name: str, values: F32, exposure: float) -> NDArray[np.uint8]:
    """Map an AOV to what an eye can read.

    Normals show as x/2 + 1/2, depth and motion relative to their 99th percentile, positions relative to their
    box, ratios by the sRGB transfer alone, and radiance with exposure and the sRGB transfer.

    Parameters
    ----------
    values : ndarray, float32, shape (H, W, C)
        Top row first.
    exposure : float
        Linear factor for radiance.

    Returns
    -------
    ndarray, uint8, shape (H, W, 3)
    """
    values = np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)
    shown: Values
    if name == "normal":
        shown = values / 2 + 0.5
    elif name == "depth":
        shown = values / _high(values)
    elif name == "motion":
        shown = values / (2 * _high(np.abs(values))) + 0.5
    elif name == "position":
        low, high = values.min(axis=(0, 1)), values.max(axis=(0, 1))
        shown = (values - low) / np.maximum(high - low, 1e-30)
    else:
        shown = srgb_encode(values * (1.0 if name in RATIOS else exposure))
    return to_8bit(_three(shown))


def _high(values: Values) -> float:
    return max(float(np.percentile(values, 99)), 1e-30)


def _three(values: Values) -> Values:
    """One component becomes grey; a missing third one is 0."""
    components = values.shape[2]
    if components == 1:
        return np.repeat(values, 3, axis=2)
    return np.pad(values, ((0, 0), (0, 0), (0, 3 - components)))
