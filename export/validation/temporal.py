"""Temporal metrics of light on surfaces: how much it changes, how sharp it is, and how bright.

Squares are products of two estimates with independent noise. The expected product of their noise is 0, so the noise of
the path-traced reference drops out. A model has a single estimate, which serves as both.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from app.arrays import F32, Bools
from app.math3d import LUMINANCE
from export.training.losses.loss_inputs import warp


@dataclass(frozen=True, eq=False)
class FrameSequence:
    """F frames of light, [F, H, W, 3] each, top row first.

    Attributes
    ----------
    first, second : ndarray, float32
        Radiance / albedo in W/(sr m²): two estimates with independent noise, or the same one twice.
    """

    first: F32
    second: F32


@dataclass(frozen=True, eq=False)
class Surfaces:
    """The surfaces that a sequence of frames shows.

    Attributes
    ----------
    counted : ndarray of bool, shape (F, H, W)
        Where light is evaluated.
    motion : ndarray, float32, shape (F - 1, 2, H, W)
        Motion of surfaces since the previous frame in pixels, right and down.
    visible : ndarray of bool, shape (F - 1, H, W)
        Whether the previous frame shows the same surface.
    """

    counted: Bools
    motion: F32
    visible: Bools


def temporal_error(sequence: FrameSequence, surfaces: Surfaces) -> float:
    """Root mean square of the differences between each frame and its motion-warped predecessor.

    Only surfaces visible in both count. For light that does not change, what remains is the blur of bilinear
    interpolation.
    """
    both = surfaces.visible & surfaces.counted[1:]
    product = _changes(sequence.first, surfaces.motion) * _changes(sequence.second, surfaces.motion)
    return math.sqrt(max(float(product[both].mean(dtype=np.float64)), 0.0))


def gradient_energy(sequence: FrameSequence, surfaces: Surfaces) -> float:
    """Mean square of the differences between neighbouring counted texels along rows and columns."""
    total, count = 0.0, 0
    for axis in (1, 2):
        pairs = np.logical_and(*_neighbours(surfaces.counted, axis))
        (a, b), (c, d) = (_neighbours(light, axis) for light in (sequence.first, sequence.second))
        total += float(((b - a) * (d - c))[pairs].sum(dtype=np.float64))
        count += 3 * int(pairs.sum())
    return max(total, 0.0) / max(count, 1)


def luminances(sequence: FrameSequence, surfaces: Surfaces) -> list[float]:
    """Mean luminance of each frame; 0 if no texel counts."""
    light = (0.5 * (sequence.first.astype(np.float64) + sequence.second)) @ LUMINANCE
    return [float(frame[mask].mean()) if mask.any() else 0.0
            for frame, mask in zip(light, surfaces.counted, strict=True)]


def frame_errors(light: F32, reference: FrameSequence, surfaces: Surfaces) -> list[float]:
    """Root mean square error of each frame in the unit of ``light``; 0 if no texel counts."""
    product = (light - reference.first) * (light - reference.second)
    return [math.sqrt(max(float(frame[mask].mean(dtype=np.float64)), 0.0)) if mask.any() else 0.0
            for frame, mask in zip(product, surfaces.counted, strict=True)]


def luminance_errors(luminance: list[float], reference: list[float], floor: float) -> list[float]:
    """Relative error of each frame's luminance; the divisor is at least ``floor`` times the reference's maximum."""
    min_divisor = max(floor * max(reference), 1e-30)
    return [abs(a - b) / max(b, min_divisor) for a, b in zip(luminance, reference, strict=True)]


def _changes(light: F32, motion: F32) -> F32:
    """Each frame from the second on, minus its warped predecessor; shape (F - 1, H, W, 3)."""
    previous = torch.from_numpy(np.ascontiguousarray(np.moveaxis(light[:-1], -1, 1)))
    warped: F32 = np.moveaxis(warp(previous, torch.from_numpy(motion)).numpy(), 1, -1)
    return light[1:] - warped


def _neighbours(values: NDArray[Any], axis: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """All values but the last along ``axis``, and all but the first."""
    n = values.shape[axis]
    return values.take(range(n - 1), axis), values.take(range(1, n), axis)
