"""Light over time: how much it changes on the surfaces that it falls on, how sharp it is, and how much there is.

Squares are taken as products of two estimates whose noise is independent, so that noise, whose product is 0 on average,
drops out of the path-traced reference; a model's light, which is all that people see, is given twice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from app.evaluation.metrics import LUMINANCE
from export.training.losses.loss_inputs import warp

F32 = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class FrameSequence:
    """F frames of light, [F, H, W, 3] each, top row first.

    Attributes
    ----------
    first, second : ndarray, float32
        Radiance / albedo in W/(sr m²); two estimates with independent noise, or the same one without any.
    """

    first: F32
    second: F32


@dataclass(frozen=True, eq=False)
class Surfaces:
    """What the frames of a film show.

    Attributes
    ----------
    counted : ndarray of bool, shape (F, H, W)
        Where light is judged.
    motion : ndarray, float32, shape (F - 1, 2, H, W)
        Pixels that a surface moved by since the frame before, right and down.
    visible : ndarray of bool, shape (F - 1, H, W)
        Whether the frame before shows that surface too.
    """

    counted: Mask
    motion: F32
    visible: Mask


def temporal_error(film: FrameSequence, surfaces: Surfaces) -> float:
    """Root mean square of each frame's difference from the one before, warped by motion, where that shows the same.

    Of light that stands still it is what bilinear interpolation blurs.
    """
    both = surfaces.visible & surfaces.counted[1:]
    product = _changes(film.first, surfaces.motion) * _changes(film.second, surfaces.motion)
    return math.sqrt(max(float(product[both].mean(dtype=np.float64)), 0.0))


def gradient_energy(film: FrameSequence, surfaces: Surfaces) -> float:
    """Mean square of the differences between neighbouring texels that both count, along rows and columns."""
    total, count = 0.0, 0
    for axis in (1, 2):
        pairs = np.logical_and(*_neighbours(surfaces.counted, axis))
        (a, b), (c, d) = (_neighbours(light, axis) for light in (film.first, film.second))
        total += float(((b - a) * (d - c))[pairs].sum(dtype=np.float64))
        count += 3 * int(pairs.sum())
    return max(total, 0.0) / max(count, 1)


def luminances(film: FrameSequence, surfaces: Surfaces) -> list[float]:
    """Mean luminance of each frame; 0 where nothing counts."""
    light = (0.5 * (film.first.astype(np.float64) + film.second)) @ LUMINANCE
    return [float(frame[mask].mean()) if mask.any() else 0.0
            for frame, mask in zip(light, surfaces.counted, strict=True)]


def errors(light: F32, reference: FrameSequence, surfaces: Surfaces) -> list[float]:
    """Root mean square difference of each frame's texels from the reference, in its unit; 0 where nothing counts."""
    product = (light - reference.first) * (light - reference.second)
    return [math.sqrt(max(float(frame[mask].mean(dtype=np.float64)), 0.0)) if mask.any() else 0.0
            for frame, mask in zip(product, surfaces.counted, strict=True)]


def luminance_errors(found: list[float], reference: list[float], floor: float) -> list[float]:
    """|found − reference| of each frame relative to the reference, or to ``floor`` times its largest value if that is more."""
    least = max(floor * max(reference), 1e-30)
    return [abs(a - b) / max(b, least) for a, b in zip(found, reference, strict=True)]


def _changes(light: F32, motion: F32) -> F32:
    """Each frame but the first − the warped one before, [F - 1, H, W, 3]."""
    before = torch.from_numpy(np.ascontiguousarray(np.moveaxis(light[:-1], -1, 1)))
    moved: F32 = np.moveaxis(warp(before, torch.from_numpy(motion)).numpy(), 1, -1)
    return light[1:] - moved


def _neighbours(values: NDArray[Any], axis: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """All texels but the last along ``axis``, and all but the first."""
    n = values.shape[axis]
    return values.take(range(n - 1), axis), values.take(range(1, n), axis)
