"""What every network does first: nothing that is not a number gets further."""

from __future__ import annotations

import torch
from torch import Tensor

from app.network.channels import CHANNELS
from app.network.contract import TensorSpec


def finite(x: Tensor, spec: TensorSpec) -> Tensor:
    """Input tensor ``x`` with NaN made 0 and everything else clamped to its channel's range."""
    ranges = torch.tensor([CHANNELS[n].range for n in spec.channels for _ in range(CHANNELS[n].components)])
    low, high = ranges.t().reshape(2, 1, -1, *[1] * (x.dim() - 2)).to(x)
    return torch.minimum(torch.maximum(x.masked_fill(torch.isnan(x), 0.0), low), high)
