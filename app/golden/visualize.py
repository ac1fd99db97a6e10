"""What a pass wrote, as a picture for people, in a data URI."""

from __future__ import annotations

import base64
import io
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from app.errors import MissingExtraError
from app.evaluation.metrics import flip_map
from app.golden.case import F32
from app.golden.comparison import Finding, radiance, texel_difference
from app.golden.tolerance import PICTURES
from app.io.image import srgb_encode, to_8bit

EMPTY = 6e4  # values from here on, such as the distance where nothing casts, don't darken the rest


def picture(image: F32, like: F32, resource: str) -> str:
    """An image with the brightness that suits ``like``: signed values around grey, others from black."""
    if resource == "display":
        return _uri(to_8bit(image[..., :3]))
    values, scale = _colours(image), _colours(like)
    usual = np.abs(scale[np.abs(scale) < EMPTY])
    largest = max(float(np.percentile(usual, 99)) if usual.size else 1.0, 1e-30)
    return _uri(to_8bit(0.5 + 0.5 * values / largest if (scale < 0).any() else srgb_encode(values / largest)))


def difference_map(finding: Finding) -> tuple[str, str]:
    """The HDR-FLIP map of a picture, else the difference of each texel, half bright at the tolerance; and its name."""
    golden, current = finding.golden, finding.current
    assert golden is not None and current is not None and finding.tolerance is not None
    if finding.resource in PICTURES:
        try:
            return _ramp(flip_map(radiance(current, finding.resource), radiance(golden, finding.resource))), "FLIP"
        except MissingExtraError:
            pass
    limit = max(finding.tolerance.difference, 1e-6)
    return _ramp(np.minimum(texel_difference(current, golden), 2 * limit) / (2 * limit)), "difference"


def _colours(image: F32) -> F32:
    """Three components, finite: one is grey, two are red and green."""
    image = np.nan_to_num(image, nan=0.0)
    if image.shape[2] == 1:
        return np.repeat(image, 3, axis=2)
    return np.pad(image, ((0, 0), (0, 0), (0, 1))) if image.shape[2] == 2 else image[..., :3]


def _ramp(values: NDArray[np.floating[Any]]) -> str:
    """0 to 1 as black, red, yellow, white."""
    return _uri(to_8bit(3 * values[..., None] - np.arange(3)))


def _uri(pixels: NDArray[np.uint8]) -> str:
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "png", optimize=True)
    return "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()
