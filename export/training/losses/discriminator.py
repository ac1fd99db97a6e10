"""A discriminator that tells pictures of light from true ones, patch by patch and one colour at a time."""

from __future__ import annotations

from itertools import pairwise
from typing import Protocol

import torch
from torch import Tensor, nn
from torch.nn.utils.parametrizations import spectral_norm

from export.training.losses.loss_inputs import LossInputs, toned

SLOPE = 0.2


class Discriminator(Protocol):
    """A ``torch.nn.Module`` that is trained against a network."""

    def fooled(self, views: LossInputs) -> Tensor:
        """What the network is to lessen."""

    def mistaken(self, views: LossInputs) -> Tensor:
        """What the discriminator itself is to lessen."""


class PatchDiscriminator(nn.Module):
    """PatchGAN (Isola et al. 2017, "Image-to-Image Translation with Conditional Adversarial Networks").

    Each output looks at 34×34 texels: two halvings, not three, since our grids are small. Spectral normalisation
    (Miyato et al. 2018) in place of batch norm keeps it from winning, and least squares (Mao et al. 2017) from
    saturating.
    """

    def __init__(self, width: int = 32) -> None:
        super().__init__()
        widths, strides = (1, width, 2 * width, 4 * width, 1), (2, 2, 1, 1)
        layers: list[nn.Module] = []
        for (inputs, outputs), stride in zip(pairwise(widths), strides, strict=True):
            layers += [spectral_norm(nn.Conv2d(inputs, outputs, 4, stride, padding=1)), nn.LeakyReLU(SLOPE)]
        self.layers = nn.Sequential(*layers[:-1])

    def forward(self, light: Tensor) -> Tensor:
        """How true each patch of toned ``light`` [B, 3, h, w] looks, near 1 or 0; [B × 3, 1, h / 4 − 2, w / 4 − 2]."""
        return torch.as_tensor(self.layers(light.flatten(0, 1).unsqueeze(1)))

    def fooled(self, views: LossInputs) -> Tensor:
        """What the network is to lessen."""
        return (self(toned(views)[0]) - 1).square().mean()

    def mistaken(self, views: LossInputs) -> Tensor:
        """What the discriminator itself is to lessen."""
        output, target = toned(views)
        return 0.5 * ((self(target) - 1).square().mean() + self(output).square().mean())
