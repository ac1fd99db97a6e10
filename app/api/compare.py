"""Errors of a picture against another one."""

import numpy as np
from numpy.typing import ArrayLike

from app.api.checked import read_array
from app.api.frame import Frame
from app.arrays import F32
from app.errors import MetricError

EXPECTED = "expected a frame, or linear radiance of the shape (H, W, 3)"


def compare(frame: Frame | ArrayLike, reference: Frame | ArrayLike) -> dict[str, float]:
    """Errors of a picture against a reference, each at the reference's own exposure.

    Parameters
    ----------
    frame, reference : Frame or array_like, shape (H, W, 3)
        Linear radiance; of frames, ``final``.

    Returns
    -------
    dict of str to float
        ``psnr`` (dB), ``ssim``, ``rel_mse`` and ``flip`` (HDR-FLIP).

    Raises
    ------
    AfterglowError
        When the shapes differ, a value is not finite, or the extra ``evaluation`` is not installed.
    """
    from app.evaluation.metrics import METRICS

    a, b = _radiance(frame), _radiance(reference)
    return {name: metric.measure(a, b) for name, metric in METRICS.items()}


def _radiance(picture: Frame | ArrayLike) -> F32:
    values = picture["final"] if isinstance(picture, Frame) else picture
    if getattr(values, "dtype", None) == np.uint8:
        raise MetricError("8-bit pixels are no radiance", "compare", EXPECTED)
    image = read_array(values, "compare", EXPECTED)
    if image.ndim != 3 or image.shape[2] != 3:
        raise MetricError(f"bad shape {image.shape}", "compare", EXPECTED)
    with np.errstate(over="ignore"):  # what becomes infinite is refused as such
        return image.astype(np.float32)
