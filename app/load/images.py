"""Image files and bytes -> RGBA pixels."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from app.errors import SceneError
from app.scene import F64

_SRGB_TO_LINEAR = np.where(
    np.arange(256) / 255 <= 0.04045, np.arange(256) / 255 / 12.92, ((np.arange(256) / 255 + 0.055) / 1.055) ** 2.4
)


def read_image(path: Path) -> NDArray[np.uint8]:
    """Pixels of an image file, uint8, shape (H, W, 4), top row first.

    Raises
    ------
    SceneError
        When the file can't be read or decoded.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SceneError("can't read the texture", path, "expected a readable image file") from error
    return decode_image(data, path)


def decode_image(data: bytes, where: object) -> NDArray[np.uint8]:
    """Pixels of an encoded image, uint8, shape (H, W, 4), top row first; 16-bit images are rounded.

    Raises
    ------
    SceneError
        When the bytes are no image that Pillow decodes.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            image: Image.Image = Image.open(io.BytesIO(data))
            if image.mode.startswith("I"):
                image = Image.fromarray((np.asarray(image, np.float64) / 257).round().clip(0, 255).astype(np.uint8))
            return np.asarray(image.convert("RGBA"))
    except Exception as error:
        raise SceneError("the texture is corrupt or of an unknown kind", where, "expected a PNG, JPEG or other image "
                         "that Pillow can decode") from error


def to_linear(pixels: NDArray[np.uint8]) -> F64:
    """sRGB-encoded bytes to linear values."""
    return np.asarray(_SRGB_TO_LINEAR[pixels])


def mean_color(pixels: NDArray[np.uint8] | NDArray[np.float32]) -> F64:
    """Mean linear colour of a texture, shape (3,)."""
    if pixels.dtype != np.uint8:
        return pixels[..., :3].mean(axis=(0, 1), dtype=np.float64)
    counts = [np.bincount(pixels[..., c].ravel(), minlength=256) for c in range(3)]
    return np.array([c @ _SRGB_TO_LINEAR / c.sum() for c in counts])
