"""What training and export ask of every network."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from torch import Tensor, nn

from app.network.contract import ModelContract


class Network(nn.Module):
    """A torch module with the contract of its tensors.

    It is called with its contract's inputs, each [B, C, h, w] or [B, C, 6, n, n], in the contract's order or by name,
    and returns radiance / albedo [B, 3, h, w] in the unit of the radiance that it was given.

    Attributes
    ----------
    remark : str
        What its model card says of how the output comes about, if the contract doesn't tell.
    """

    contract: ModelContract
    remark: str = ""

    def export_contract(self) -> ModelContract:
        """The contract of its exported file, whose inputs may have more texels than in training."""
        return self.contract


class Conditioned(Protocol):
    """What a network has whose loss looks at ``LossInputs.condition``."""

    def condition(self, **inputs: Tensor) -> Tensor:
        """[B, K, h, w], of the contract's inputs."""


class StaticSplit(Protocol):
    """What a network has whose contract names a ``static_input``."""

    def precompute(self, source: Tensor) -> Sequence[Tensor]:
        """What depends on that input alone."""

    def finish(self, cached: Sequence[Tensor], *others: Tensor) -> Tensor:
        """The output, from that and the other inputs in the contract's order."""
