"""KTX2 textures with a Basis Universal payload (KHR_texture_basisu) -> RGBA pixels, by opengl_basisu."""

import struct

from app.arrays import Bytes
from app.extras import extra_module

_SIGNATURE = b"\xabKTX 20\xbb\r\n\x1a\n"


def is_ktx2(data: bytes) -> bool:
    """Whether an encoded image is a KTX2 file."""
    return data.startswith(_SIGNATURE)


def size(data: bytes) -> tuple[int, int]:
    """Width and height of a KTX2 file, from its header."""
    width, height = struct.unpack_from("<II", data, 20)
    return width, height


def decode(data: bytes) -> Bytes:
    """Pixels of the finest level, uint8, shape (H, W, 4), top row first.

    Raises
    ------
    MissingExtraError
        When opengl_basisu is not installed.
    ValueError
        When the file is corrupt or has no payload of ETC1S or UASTC.
    """
    pixels: Bytes = extra_module("opengl_basisu", "assets").open(data).transcode("rgba8").data
    return pixels
