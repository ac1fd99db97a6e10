"""Normalization of light by the mean of each colour, so that the input does not depend on exposure or light colour.

Hence f(αx) = αf(x) holds for each colour whose mean is above ``MIN_MEAN``, and networks need not learn it.
"""

import torch
from torch import Tensor

from app.network.channels import HALF_MAX
from app.network.inputs import MAX_RATIO_TO_MEAN

MIN_MEAN = 1e-6      # divisors are raised to this
MIN_COVERAGE = 1e-6  # share of texels with a surface; a frame that shows only sky gives 0


def normalize_channels(light: Tensor, surface: Tensor) -> tuple[Tensor, Tensor]:
    """Divide light by its mean over surfaces, colour by colour.

    A texel counts for at most ``MAX_RATIO_TO_MEAN`` times the mean.

    Parameters
    ----------
    light : Tensor, shape (B, 3, h, w)
    surface : Tensor, shape (B, 1, h, w)
        1 on surfaces, 0 in the sky.

    Returns
    -------
    normalized : Tensor, shape (B, 3, h, w)
    means : Tensor, float32, shape (B, 3, 1, 1)
    """
    surface = surface.float()
    coverage = surface.mean((2, 3), keepdim=True).clamp(min=MIN_COVERAGE)
    lit = light.float() * surface
    plain = lit.mean((2, 3), keepdim=True) / coverage
    means = torch.minimum(lit, MAX_RATIO_TO_MEAN * plain).mean((2, 3), keepdim=True) / coverage
    return (light.float() / means.clamp(min=MIN_MEAN)).clamp(max=MAX_RATIO_TO_MEAN).to(light.dtype), means


def denormalize_channels(normalized: Tensor, means: Tensor) -> Tensor:
    """The light [B, 3, h, w] that was normalized by ``means``, float32, clamped to the range of half precision."""
    return (normalized.float() * means).clamp(max=HALF_MAX)
