"""Pictures to look at beside the errors."""

from pathlib import Path

import numpy as np
from PIL import Image

from app.arrays import F32
from app.evaluation.metrics import tone_map
from app.io.atomic_files import replace_file


def write_picture(path: Path, picture: F32, exposure: float) -> None:
    """Write radiance, shape (H, W, 3), times ``exposure``, as a PNG that is whole or not there."""
    pixels = np.asarray(255 * tone_map(picture, exposure) + 0.5, np.uint8)
    with replace_file(path) as temporary:
        Image.fromarray(pixels).save(temporary, "png")
