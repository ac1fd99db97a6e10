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
    """An sRGB-encoded picture, shape (H, W, 3), as a JPEG file."""
    data = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(data, "jpeg", quality=QUALITY, subsampling=FULL_COLOUR)
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
