"""Light in units of each colour's own mean: what goes in is alike at any exposure and colour of the light.

So f(αx) = αf(x) holds in each colour as long as its mean is above ``DARKEST``, and networks need not learn it.
"""

from __future__ import annotations

import torch
from torch import Tensor

from app.network.channels import HALF_MAX
from app.network.session import FIREFLY

DARKEST = 1e-6         # smallest mean that is divided by
MIN_SHARE = 1e-6  # of the texels; so that a frame of sky gives 0


def in_own_means(light: Tensor, surface: Tensor) -> tuple[Tensor, Tensor]:
    """``light`` [B, 3, h, w] over its colours' means, and the means over surfaces, [B, 3, 1, 1] in single precision."""
    surface = surface.float()
    share = surface.mean((2, 3), keepdim=True).clamp(min=MIN_SHARE)
    lit = light.float() * surface
    plain = lit.mean((2, 3), keepdim=True) / share
    means = torch.minimum(lit, FIREFLY * plain).mean((2, 3), keepdim=True) / share
    return (light.float() / means.clamp(min=DARKEST)).clamp(max=FIREFLY).to(light.dtype), means


def times_means(relative: Tensor, means: Tensor) -> Tensor:
    """Light of ``relative`` [B, 3, h, w], in single precision, though no more than half precision holds."""
    return (relative.float() * means).clamp(max=HALF_MAX)
