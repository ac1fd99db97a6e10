"""Any AOV as an 8-bit image for display."""

import numpy as np

from app.arrays import F32, Bytes, Floats
from app.io.image import srgb_encode, to_8bit
from app.math3d import GOLDEN_RATIO

LABELS = ("instance", "material")
RATIOS = ("albedo", "roughness")  # which exposure does not apply to


def preview(name: str, values: F32, exposure: float) -> Bytes:
    """Map an AOV to a displayable range.

    Normals show as x/2 + 1/2, ids as a colour each, depth, motion and flow relative to their 99th percentile, positions
    relative to their box, ratios by the sRGB transfer alone, and radiance with exposure and the sRGB transfer.

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
    display: Floats
    if name == "normal":
        display = values / 2 + 0.5
    elif name == "depth":
        display = values / _white_level(values)
    elif name in LABELS:
        display = _label_colors(values)
    elif name in ("motion", "flow"):
        display = values / (2 * _white_level(np.abs(values))) + 0.5
    elif name == "position":
        low, high = values.min(axis=(0, 1)), values.max(axis=(0, 1))
        display = (values - low) / np.maximum(high - low, 1e-30)
    else:
        display = srgb_encode(values * (1.0 if name in RATIOS else exposure))
    return to_8bit(_to_rgb(display))


def _label_colors(ids: Floats) -> Floats:
    """A colour for each id, black for 0: hues at steps of the golden angle, so that neighbouring ids differ most."""
    hue = (ids * GOLDEN_RATIO) % 1.0 * 6.0
    rgb = np.clip(np.abs((hue + np.array([0.0, 4.0, 2.0])) % 6.0 - 3.0) - 1.0, 0.0, 1.0)
    return np.where(ids > 0, 0.25 + 0.75 * rgb, 0.0)


def _white_level(values: Floats) -> float:
    return max(float(np.percentile(values, 99)), 1e-30)


def _to_rgb(values: Floats) -> Floats:
    """One component becomes grey; a missing third component is 0."""
    components = values.shape[2]
    if components == 1:
        return np.repeat(values, 3, axis=2)
    return np.pad(values, ((0, 0), (0, 0), (0, 3 - components)))
