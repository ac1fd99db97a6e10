"""Pictures to look at beside the errors."""

from pathlib import Path

import numpy as np
from PIL import Image

from app.arrays import F32
from app.evaluation.metrics import tone_map
from app.io.atomic_files import replace_file


def write_picture(path: Path, picture: F32, exposure: float) -> None:
    """Write radiance, shape (H, W, 3), times ``exposure``, as a PNG that is whole or not there."""
    write_shown(path, tone_map(picture, exposure))


def write_shown(path: Path, shown: F32) -> None:
    """Write values as a screen shows them, shape (H, W, 3), in 0 to 1, as a PNG that is whole or not there."""
    with replace_file(path) as temporary:
        Image.fromarray(np.asarray(255 * shown + 0.5, np.uint8)).save(temporary, "png")
