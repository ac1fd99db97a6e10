"""Metrics of detail in indirect light that PSNR hides: gradients at edges, and variation within a coarse texel.

Squares are products of errors against two references with independent noise, so that their noise drops out. Light is
relative to its mean in the texels of 16×16 pixels around, so that dim places count as much as bright ones. An error of
1 is that of light without any detail, 0 that of light with exactly the reference's.
"""

import math

import numpy as np

from app.arrays import F32, F64, Bools
from app.math3d import LUMINANCE

TEXEL = 16               # pixels
EDGE_RADIUS = 4          # pixels around an edge that count as being at it
MIN_NORMAL_COSINE = 0.9  # between neighbouring pixels of one surface
MAX_BEND = 0.01          # second difference of inverse depth, relative to it; 0 on planes
MIN_LIGHT = 0.05         # of the frame's mean, that errors are relative to at least


class DetailMetrics:
    """Errors against the two halves of a reference.

    Parameters
    ----------
    first, second : ndarray, float32, shape (H, W, 3)
        Indirect radiance / albedo.
    normal : ndarray, float32, shape (H, W, 3)
    depth : ndarray, float32, shape (H, W)
    counted : ndarray of bool, shape (H, W)
        Where light is evaluated.
    """

    def __init__(self, first: F32, second: F32, normal: F32, depth: F32, counted: Bools) -> None:
        self._counted = counted
        self._at_edges = near_edges(normal, depth) & counted
        luminance = (first.astype(np.float64) + second) / 2 @ LUMINANCE
        mean = _texel_means(luminance[..., None], counted)
        self._scale = 1 / (mean + MIN_LIGHT * luminance[counted].mean())
        self._halves = tuple(self._scale * half for half in (first, second))

    def edge_gradient(self, light: F32) -> float:
        """Error of the differences between neighbouring pixels within ``EDGE_RADIUS`` of silhouettes and creases."""
        images = [self._scale * light, *self._halves]
        error = energy = 0.0
        for axis in (0, 1):
            pair = np.logical_and(*_neighbours(self._at_edges, axis))
            a, b, c = (np.subtract(*_neighbours(image, axis))[pair] for image in images)
            error, energy = error + float(((a - b) * (a - c)).sum()), energy + float((b * c).sum())
        return _relative(error, energy)

    def texel_variation(self, light: F32) -> float:
        """Error of the differences from the mean over 16×16 pixels, the texel of a coarse grid."""
        a, b, c = ((image - _texel_means(image, self._counted))[self._counted]
                   for image in (self._scale * light, *self._halves))
        return _relative(float(((a - b) * (a - c)).sum()), float((b * c).sum()))


def near_edges(normal: F32, depth: F32) -> Bools:
    """Pixels within ``EDGE_RADIUS`` of a silhouette or a crease, shape (H, W)."""
    inverse = np.where(depth > 0, 1 / np.maximum(depth, 1e-30), 0).astype(np.float64)
    edge = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        a, b = _neighbours(normal, axis)
        crease = (a * b).sum(axis=-1) < MIN_NORMAL_COSINE
        inner = _slices(axis, 1, -1)
        bend = np.abs(np.diff(inverse, 2, axis=axis)) > MAX_BEND * inverse[inner]
        edge[_slices(axis, 1, None)] |= crease
        edge[inner] |= bend
    for axis in (0, 1):
        edge = np.logical_or.reduce([_shifted(edge, by, axis) for by in range(-EDGE_RADIUS, EDGE_RADIUS + 1)])
    return edge


def _relative(error: float, energy: float) -> float:
    return math.sqrt(max(error, 0.0) / energy) if energy > 0 else 0.0


def _texel_means(image: F64, counted: Bools) -> F64:
    """Mean of each texel's counted pixels, at all of its pixels."""
    h, w = counted.shape
    rows, columns = (np.arange(0, n, TEXEL) for n in (h, w))

    def sums(values: F64) -> F64:
        total = np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1)
        return np.repeat(np.repeat(total, TEXEL, axis=0), TEXEL, axis=1)[:h, :w]

    count = sums(counted[..., None].astype(np.float64))
    return sums(np.where(counted[..., None], image, 0.0)) / np.maximum(count, 1)


def _neighbours(values: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    return values[_slices(axis, None, -1)], values[_slices(axis, 1, None)]


def _slices(axis: int, start: int | None, stop: int | None) -> tuple[slice, ...]:
    return (slice(None),) * axis + (slice(start, stop),)


def _shifted(mask: Bools, by: int, axis: int) -> Bools:
    """The mask moved along an axis; nothing enters from beyond the image."""
    moved = np.zeros_like(mask)
    n = mask.shape[axis]
    moved[_slices(axis, max(by, 0), n + min(by, 0))] = mask[_slices(axis, max(-by, 0), n - max(by, 0))]
    return moved
