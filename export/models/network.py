"""What training and export ask of every network."""

from __future__ import annotations

from torch import nn

from app.contract import ModelContract


class Network(nn.Module):
    """A torch module with the contract of its tensors.

    It is called with its contract's inputs, each [B, C, h, w] or [B, C, 6, n, n], in the contract's order or by name,
    and returns radiance / albedo [B, 3, h, w] in the unit of the radiance that it was given.
    """

    contract: ModelContract
