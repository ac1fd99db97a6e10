"""Gives cleaned light the local mean of what was cleaned.

Kernels that are predicted from light take what few rays find, such as the bright housing of a tube, for noise, and
leave it out: what is cleaned is darker than its rays. By the means of many texels that can be told from noise.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from export.models.edge_avoiding import AROUND, NORMAL_WEIGHT, Surfaces, around, dot, surfaces_of

CELL = 4       # texels along the edge of the cells whose means are compared
STEPS = 3, 1   # cells between the taps of two kernels of 3×3, which together reach each of 9×9 cells once
MAX_NOISE = 0.2    # standard deviation of the gathered mean, relative to it, at which half of the difference counts
MAX_RATIO = 4.0    # by which light is corrected at most
MIN_LIGHT = 1e-12  # so that nothing divides by 0


def keep_local_mean(light: Tensor, gathered: Tensor, count: Tensor, normal: Tensor, position: Tensor) -> Tensor:
    """Cleaned light times the ratio of the local means before and after, as far as noise lets it be known.

    Parameters
    ----------
    light, gathered : Tensor, shape (B, 3, h, w)
        Cleaned light, and the mean of each texel's rays; h and w multiples of ``CELL``.
    count : Tensor, shape (B, 1, h, w)
        Rays of each texel, by which it counts; 0 in the sky.
    normal, position : Tensor, shape (B, 3, h, w)
        In view space; 0 in the sky.

    Returns
    -------
    Tensor, shape (B, 3, h, w)
    """
    before = gathered * count
    square = dot(before, before) / (3 * CELL**2)  # a texel's variance at most, if others' is another
    cells = functional.avg_pool2d(torch.cat([before, light * count, square], 1), CELL)
    means, variance = torch.split(cells, [6, 1], 1)
    normal, position = (x[:, :, CELL // 2::CELL, CELL // 2::CELL] for x in (normal, position))
    surfaces = surfaces_of(normal, position)
    for step in STEPS:
        means, variance = _averaged(means, variance, surfaces, step)
    before, after = torch.split(means, 3, 1)
    noise = variance / (before.mean(1, keepdim=True).square() + MIN_LIGHT**2)
    known = 1 / (1 + noise / MAX_NOISE**2)
    ratio = ((before + MIN_LIGHT) / (after + MIN_LIGHT)).clamp(1 / MAX_RATIO, MAX_RATIO)
    return light * functional.interpolate(1 + known * (ratio - 1), scale_factor=float(CELL), mode="bilinear")


def _averaged(means: Tensor, variance: Tensor, surfaces: Surfaces, step: int) -> tuple[Tensor, Tensor]:
    """Means over the cells ``step`` around each one and itself, and the variance of these means."""
    cells = torch.cat([surfaces.normal, surfaces.position, means, variance], 1)
    taps = torch.stack([cells, *around(cells, step, AROUND)], 1)  # (B, 9, 13, h, w)
    normal, position, means, variance = torch.split(taps, [3, 3, 6, 1], 2)
    cosine, plane = ((own.unsqueeze(1) * other).sum(2, keepdim=True)
                     for own, other in ((surfaces.normal, normal), (surfaces.axis, position)))
    # Below 0 also where garbage has made normals long.
    logit = (NORMAL_WEIGHT * (cosine - 1) - (plane - surfaces.plane.unsqueeze(1)).square()).clamp(max=0.0)
    kernel = logit.exp()
    kernel = kernel / (kernel.sum(1, keepdim=True) + MIN_LIGHT)
    return (means * kernel).sum(1), (variance * kernel.square()).sum(1)
