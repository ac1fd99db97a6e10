"""The interface that training and export expect of every network, and what several networks share."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor, nn

from app.network.channels import CHANNELS
from app.network.contract import ModelContract, TensorSpec

EXTENT = 40.0         # length of the scene's longest edge in the networks' units
NEGATIVE_SLOPE = 0.1  # of LeakyReLU
MAX_POSITION = 2.0    # and of depths, in extents, so that no input overflows half precision
MAX_LOGIT = 11.0      # of exponentials: 6·10⁴ means


class Network(nn.Module):
    """A torch module with the contract of its tensors.

    It is called with the contract's inputs, each [B, C, h, w] or [B, C, 6, n, n], in the contract's order or by name,
    and returns radiance / albedo [B, 3, h, w] in the unit of the input radiance. One with several outputs returns them
    in the contract's order, that one first.

    Attributes
    ----------
    remark : str
        How the network computes its output, for the model card, where the contract does not say.
    """

    contract: ModelContract
    remark: str = ""

    def export_contract(self) -> ModelContract:
        """The contract of the exported file, whose inputs may have a higher resolution than in training."""
        return self.contract


@dataclass(frozen=True)
class Preset:
    """Channels of each level from the finest to the coarsest, and the grid relative to the image."""

    widths: tuple[int, ...]
    scale: float


class Conditioned(Protocol):
    """A network whose loss reads ``LossInputs.condition``."""

    def condition(self, **inputs: Tensor) -> Tensor:
        """The condition [B, K, h, w] for the contract's inputs."""


class StaticSplit(Protocol):
    """A network whose contract names a ``static_input``."""

    def precompute(self, source: Tensor) -> Sequence[Tensor]:
        """Everything that depends on the static input alone."""

    def finish(self, cached: Sequence[Tensor], *others: Tensor) -> Tensor:
        """The output, from the precomputed tensors and the other inputs in the contract's order."""


def outputs_of(result: Tensor | tuple[Tensor, ...]) -> tuple[Tensor, ...]:
    """What a network returned, as a tuple in the order of its contract."""
    return result if isinstance(result, tuple) else (result,)


def sanitize(x: Tensor, spec: TensorSpec) -> Tensor:
    """Input tensor ``x`` with NaN replaced by 0 and all other values clamped to the range of their channel."""
    ranges = torch.tensor([CHANNELS[n].range for n in spec.channels for _ in range(CHANNELS[n].components)])
    low, high = ranges.t().reshape(2, 1, -1, *[1] * (x.dim() - 2)).to(x)
    return torch.minimum(torch.maximum(x.masked_fill(torch.isnan(x), 0.0), low), high)


def geometric_tail(last: Tensor, ratio: Tensor, count: Tensor) -> Tensor:
    """Sum of the next ``count`` terms of a geometric series: last · (ratio + ratio² + … + ratio^count).

    Parameters
    ----------
    last : Tensor
        The last term that was summed explicitly.
    ratio : Tensor
        Of each term to the one before, in [0, 1).
    count : Tensor
        Number of terms; the sum is 0 for 0 and below, and exactly the infinite series where ratio^count underflows.
    """
    return last * ratio / (1 - ratio) * (1 - ratio ** count.clamp(min=0))
