"""Pictures as JPEG, and the binary message that carries them."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from app.view.state import Json

QUALITY = 90
FULL_COLOUR = 0  # no chroma subsampling: thin coloured edges stay

Pixels = NDArray[np.uint8]


def jpeg(pixels: Pixels) -> bytes:
    """An sRGB-encoded picture, shape (H, W, 3), or (H, W, 4) whose last counts for nothing, as a JPEG file."""
    height, width, components = pixels.shape
    mode = "RGBX" if components == 4 else "RGB"  # four go to the encoder as they lie there, three are copied twice
    picture = Image.frombuffer(mode, (width, height), np.ascontiguousarray(pixels), "raw", mode, 0, 1)
    data = io.BytesIO()
    picture.save(data, "jpeg", quality=QUALITY, subsampling=FULL_COLOUR)
    return data.getvalue()


def packed(header: Json, parts: Sequence[bytes]) -> bytes:
    """Length of the header (32 bits, little-endian), the header as JSON with the ``parts``' lengths, and the parts."""
    text = json.dumps({**header, "parts": [len(part) for part in parts]}).encode()
    return b"".join([struct.pack("<I", len(text)), text, *parts])


def unpacked(message: bytes) -> tuple[Json, list[bytes]]:
    """Header and parts of a message."""
    at = 4 + struct.unpack_from("<I", message)[0]
    header, parts = json.loads(message[4:at]), []
    for length in header["parts"]:
        parts.append(message[at:at + length])
        at += length
    return header, parts
