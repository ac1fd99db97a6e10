"""Means over texels of the same surface, by kernels of 3×3 taps that edges of normals and depths limit.

Dammertz et al. 2010, "Edge-Avoiding À-Trous Wavelet Transform for fast Global Illumination Filtering".
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from torch import Tensor
from torch.nn import functional

AROUND = (-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, 1), (1, -1), (-1, 1)  # taps beside the middle one
# Logit of a tap, its prior: minus
NORMAL_WEIGHT = 16.0   # times 1 - the cosine between the normals,
PLANE_SIGMA = 0.02     # and the squared distance from the texel's plane, in units of this share of the depth
MIN_DEPTH = 1e-3       # in the unit of EXTENT
MIN_EXPONENT, MAX_EXPONENT = -40.0, 30.0  # of the middle tap, so that kernels have a finite sum above 0


@dataclass(frozen=True)
class Surfaces:
    """What the prior compares, each of shape (B, C, h, w).

    Attributes
    ----------
    normal, position : Tensor
        Unit normals, or 0 in the sky, and positions.
    axis : Tensor
        Normals in units of the tolerated distance from a texel's plane.
    plane : Tensor
        Where the texel's own plane is, in that unit.
    """

    normal: Tensor
    position: Tensor
    axis: Tensor
    plane: Tensor

    def priors(self, step: int) -> Iterator[Tensor]:
        """What is added to the logits of the texels ``step`` away, in the order of ``AROUND``."""
        for cosine, position in zip(self._cosines(step), around(self.position, step, AROUND), strict=True):
            yield cosine - (dot(self.axis, position) - self.plane).square()

    def _cosines(self, step: int) -> Iterator[Tensor]:
        """Cosines between normals minus 1, times ``NORMAL_WEIGHT``; for opposite sides the same ones, moved."""
        sides = AROUND[::2]
        for (right, down), normal in zip(sides, around(self.normal, step, sides), strict=True):
            cosine = dot(self.normal, normal, NORMAL_WEIGHT, -NORMAL_WEIGHT)
            yield cosine
            yield shifted(cosine, -step * right, -step * down, value=-NORMAL_WEIGHT)


def surfaces_of(normal: Tensor, position: Tensor) -> Surfaces:
    """For unit normals, or 0 in the sky, and positions of shape (B, 3, h, w)."""
    axis = normal / (PLANE_SIGMA * (-position[:, 2:]).clamp(min=MIN_DEPTH))
    return Surfaces(normal, position, axis, dot(axis, position))


def filter_light(lit: Tensor, surfaces: Surfaces, middle: Tensor, logits: Sequence[Tensor], step: int) -> Tensor:
    """Weighted mean of ``lit`` of the texels ``step`` away from each one.

    Tap by tap, since tensors of all taps would not stay in the CPU's cache.

    Parameters
    ----------
    lit : Tensor, shape (B, 4, h, w)
        Light times how much each texel counts, and how much it counts, relative to others.
    middle : Tensor, shape (B, 1, h, w)
        Logit of each texel itself.
    logits : sequence of Tensor, shape (B, 1, h, w)
        Logits of those ``AROUND``, which are added to the prior.
    """
    total = middle.clamp(MIN_EXPONENT, MAX_EXPONENT).exp()
    sums = lit * total
    for logit, prior, light in zip(logits, surfaces.priors(step), around(lit, step, AROUND), strict=True):
        kernel = (logit + prior).exp()
        total = total + kernel
        sums = sums + light * kernel
    return sums / total


def dot(a: Tensor, b: Tensor, factor: float = 1.0, offset: float = 0.0) -> Tensor:
    """Scalar products of vectors of shape (B, 3, h, w), times a factor, plus an offset."""
    # In onnxruntime fastest as a convolution, in three dimensions, since it rearranges the channels for one in two.
    weight, bias = a.new_full((1, 3, 1, 1, 1), factor), a.new_full((1,), offset)
    return functional.conv3d((a * b).unsqueeze(2), weight, bias).squeeze(2)


def around(x: Tensor, step: int, sides: Sequence[tuple[int, int]]) -> Iterator[Tensor]:
    """The texels ``step`` to these sides of each one; 0 beyond the image."""
    padded = functional.pad(x, (step,) * 4)
    return (shifted(padded, step * right, step * down, -step) for right, down in sides)


def shifted(x: Tensor, right: int, down: int, margin: int = 0, value: float = 0.0) -> Tensor:
    """The texels to the right and below of each one, without a margin of ``x``; ``value`` beyond ``x``."""
    return functional.pad(x, (margin - right, margin + right, margin - down, margin + down), value=value)
