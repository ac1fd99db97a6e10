"""The surrounding-aware network's loss (Mahmud et al. 2022), as pix2pix's: L1, and a discriminator that sees the inputs."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from export.models.surround import COLORS, SEEN, Discriminator, to_tanh
from export.training.losses.loss_inputs import LossInputs, mean_where


class SurroundLoss:
    """100 × L1 between light maps on Tanh's scale + what a discriminator makes of them, by binary cross-entropy.

    Both look at what the screen shows of the light map, since the reference is known there alone, in means of the sphere.

    Parameters
    ----------
    l1, adversarial : float
        Weights; there is no discriminator where the second is 0.
    widths : sequence of int
        The discriminator's channels.

    Attributes
    ----------
    discriminator : ConditionalCritic or None
        To be trained along.

    Raises
    ------
    ValueError
        For a weight that is not above 0, or below it for the second, and for widths below 1.
    """

    uses_previous = False
    uses_condition = True

    def __init__(self, l1: float = 100.0, adversarial: float = 1.0,
                 widths: Sequence[int] = (64, 128, 256, 512)) -> None:
        if not (0 < float(l1) < math.inf and 0 <= float(adversarial) < math.inf and min(map(int, widths)) > 0):
            raise ValueError(f"weights {l1}, {adversarial}, widths {widths}")
        self.l1, self.adversarial = l1, adversarial
        self.discriminator = ConditionalCritic(widths) if adversarial > 0 else None

    def __call__(self, views: LossInputs) -> dict[str, Tensor]:
        output, target = light_maps(views)
        terms = {"l1": self.l1 * mean_where((output - target).abs(), views.seen)}
        if self.discriminator is not None:
            terms["adversarial"] = self.adversarial * self.discriminator.fooled(views)
        return terms


class ConditionalCritic(nn.Module):
    """The thesis's discriminator of what the network saw with a light map."""

    def __init__(self, widths: Sequence[int]) -> None:
        super().__init__()
        self.discriminator = Discriminator(tuple(widths))

    def fooled(self, views: LossInputs) -> Tensor:
        """What the network is to lessen."""
        return self._told(views, light_maps(views)[0], 1.0)

    def mistaken(self, views: LossInputs) -> Tensor:
        """What the discriminator itself is to lessen."""
        output, target = light_maps(views)
        return 0.5 * (self._told(views, target, 1.0) + self._told(views, output, 0.0))

    def _told(self, views: LossInputs, light: Tensor, reference: float) -> Tensor:
        assert views.condition is not None
        logits = self.discriminator(views.condition[:, :SEEN], light)
        return functional.binary_cross_entropy_with_logits(logits, torch.full_like(logits, reference))


def light_maps(views: LossInputs) -> tuple[Tensor, Tensor]:
    """Direct and indirect light without albedo of network and reference, in means of the sphere on Tanh's scale; -1 in the
    sky.
    """
    assert views.condition is not None
    direct, unit = torch.split(views.condition[:, SEEN:], [COLORS, 1], dim=1)
    output, target = (to_tanh((light / unit + direct) * views.seen) for light in (views.output, views.target))
    return output, target
