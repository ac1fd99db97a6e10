"""Image files and bytes -> RGBA pixels."""

import io
import warnings
from pathlib import Path

import numpy as np
from PIL import Image

from app.arrays import F64, Bytes
from app.errors import MissingExtraError, SceneError
from app.io.image import srgb_decode
from app.load import ktx2

MAX_PIXELS = 2**27  # of a texture: 512 MB; a small file can hold more, all of one colour
_SRGB_TO_LINEAR: F64 = srgb_decode(np.arange(256) / 255)


def read_image(path: Path) -> Bytes:
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


def decode_image(data: bytes, where: object) -> Bytes:
    """Pixels of an encoded image, uint8, shape (H, W, 4), top row first; 16-bit images are rounded.

    Raises
    ------
    SceneError
        When the image can't be decoded or has more than ``MAX_PIXELS`` pixels; it names ``where``.
    MissingExtraError
        When the image is a KTX2 file and the package that decodes it is not installed.
    """
    try:
        if ktx2.is_ktx2(data):
            _check_size(ktx2.size(data), where)
            return ktx2.decode(data)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            image: Image.Image = Image.open(io.BytesIO(data))
            _check_size(image.size, where)
            if image.mode.startswith("I"):
                image = Image.fromarray((np.asarray(image, np.float64) / 257).round().clip(0, 255).astype(np.uint8))
            return np.asarray(image.convert("RGBA"))
    except (SceneError, MissingExtraError):
        raise
    except Image.DecompressionBombError as error:
        raise _too_large(where) from error
    except Exception as error:  # the decoders raise many kinds
        raise SceneError("the texture is corrupt or in an unknown format", where,
                         "expected a KTX2 file, or a PNG, JPEG or other image that Pillow can decode") from error


def _check_size(size: tuple[int, int], where: object) -> None:
    if size[0] * size[1] > MAX_PIXELS:
        raise _too_large(where)


def _too_large(where: object) -> SceneError:
    return SceneError("the texture is too large", where, f"expected at most {MAX_PIXELS:,} pixels")


def to_linear(pixels: Bytes) -> F64:
    """sRGB-encoded bytes to linear values."""
    return np.asarray(_SRGB_TO_LINEAR[pixels])
