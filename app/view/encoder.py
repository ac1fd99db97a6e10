"""JPEG images and the binary messages that carry them."""

import io
import json
import struct
from collections.abc import Sequence

import numpy as np
from PIL import Image

from app.arrays import Bytes
from app.evaluation.reference import Reference
from app.io.aov_preview import preview
from app.io.tone_maps import automatic_exposure, tone_map
from app.view.state import FINAL, REFERENCE, Json, State

QUALITY = 90
NO_SUBSAMPLING = 0  # full-resolution chroma keeps thin coloured edges
REFERENCE_LAYERS = ("direct", "indirect", "albedo")  # the AOVs that a reference contains


def encode_jpeg(pixels: Bytes) -> bytes:
    """Encode an sRGB image, shape (H, W, 3) or (H, W, 4) with an ignored fourth component, as a JPEG file."""
    height, width, components = pixels.shape
    mode = "RGBX" if components == 4 else "RGB"  # RGBX reaches the encoder uncopied, RGB is copied twice
    image = Image.frombuffer(mode, (width, height), np.ascontiguousarray(pixels), "raw", mode, 0, 1)
    data = io.BytesIO()
    image.save(data, "jpeg", quality=QUALITY, subsampling=NO_SUBSAMPLING)
    return data.getvalue()


def encode_reference(reference: Reference, state: State) -> bytes:
    """Encode the layer of ``reference`` that matches the AOV shown in ``state`` as a binary message."""
    layer = state.aov if state.aov in REFERENCE_LAYERS else FINAL
    values = reference.layers[layer]
    if layer == FINAL:
        exposure = state.exposure * (automatic_exposure(values) if state.auto_exposure else 1.0)
        pixels = tone_map(values, exposure, state.tonemap)
    else:
        pixels = preview(layer, values, state.exposure)
    return pack_message({"kind": REFERENCE, "spp": reference.about["spp"]}, [encode_jpeg(pixels)])


def pack_message(header: Json, files: Sequence[bytes]) -> bytes:
    """Join the header's length (32 bits, little-endian), the header as JSON with the file lengths, and the files."""
    text = json.dumps({**header, "lengths": [len(file) for file in files]}).encode()
    return b"".join([struct.pack("<I", len(text)), text, *files])


def unpack_message(message: bytes) -> tuple[Json, list[bytes]]:
    """Split a binary message into its header and files."""
    start = 4 + struct.unpack_from("<I", message)[0]
    header, files = json.loads(message[4:start]), []
    for length in header["lengths"]:
        files.append(message[start:start + length])
        start += length
    return header, files
