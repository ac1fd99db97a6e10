"""Linear pictures as small data URIs, for a page without other files."""

from __future__ import annotations

import base64
import io
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from app.evaluation.metrics import exposure_of, flip_map, tone_map
from app.extras import extra_module
from app.io.image import to_8bit

F32 = NDArray[np.float32]

QUALITY = 92


def shown(pictures: dict[str, F32], compared_to: str = "reference") -> dict[str, dict[str, str]]:
    """For each label the ``picture`` with the reference's exposure, and its ``flip`` map (dark is near the reference).

    Parameters
    ----------
    pictures : dict of str to ndarray, float32, shape (H, W, 3)
        Linear.
    compared_to : str
        Which of them the others are compared with.
    """
    reference = pictures[compared_to]
    exposure = exposure_of(reference)
    magma = extra_module("matplotlib", "judge").colormaps["magma"]
    return {label: {"picture": _uri(to_8bit(tone_map(image, exposure))),
                    "flip": _uri(to_8bit(np.asarray(magma(flip_map(image, reference)))[..., :3]))}
            for label, image in pictures.items()}


def _uri(pixels: NDArray[Any]) -> str:
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, "webp", quality=QUALITY, method=6)
    return "data:image/webp;base64," + base64.b64encode(data.getvalue()).decode()
