"""The surrounding-aware network's loss (Mahmud et al. 2022), as in pix2pix: L1 and a conditional discriminator."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from export.models.pix2pix import COLORS, FEATURES, ConditionalPatchGan
from export.models.surround import to_tanh
from export.training.losses.loss_inputs import LossInputs, masked_mean


class SurroundLoss:
    """100 × L1 between light maps on the scale of Tanh + the discriminator's binary cross-entropy.

    Both terms compare the part of the light map that the screen shows, since the reference is known only there.

    Parameters
    ----------
    l1, adversarial : float
        Weights; there is no discriminator if the second is 0.
    widths : sequence of int
        The discriminator's channels.

    Attributes
    ----------
    discriminator : ConditionalDiscriminator or None
        The discriminator that is trained with the network.

    Raises
    ------
    ValueError
        Unless ``l1`` is positive, ``adversarial`` is not negative and all widths are positive.
    """

    uses_previous = False
    uses_condition = True

    def __init__(self, l1: float = 100.0, adversarial: float = 1.0,
                 widths: Sequence[int] = (64, 128, 256, 512)) -> None:
        if not (0 < float(l1) < math.inf and 0 <= float(adversarial) < math.inf and min(map(int, widths)) > 0):
            raise ValueError(f"weights {l1}, {adversarial}, widths {widths}: only the second may be 0")
        self.l1, self.adversarial = l1, adversarial
        self.discriminator = ConditionalDiscriminator(widths) if adversarial > 0 else None

    def __call__(self, inputs: LossInputs) -> dict[str, Tensor]:
        output, target = light_maps(inputs)
        terms = {"l1": self.l1 * masked_mean((output - target).abs(), inputs.surface_mask)}
        if self.discriminator is not None:
            terms["adversarial"] = self.adversarial * self.discriminator.generator_loss(inputs)
        return terms


class ConditionalDiscriminator(nn.Module):
    """The thesis's discriminator of light maps, conditioned on the generator's input."""

    def __init__(self, widths: Sequence[int]) -> None:
        super().__init__()
        self.network = ConditionalPatchGan(tuple(widths))

    def generator_loss(self, inputs: LossInputs) -> Tensor:
        """Cross-entropy of the network's output with the label "real"."""
        return self._cross_entropy(inputs, light_maps(inputs)[0], 1.0)

    def discriminator_loss(self, inputs: LossInputs) -> Tensor:
        """Mean cross-entropy of target and output with their labels."""
        output, target = light_maps(inputs)
        return 0.5 * (self._cross_entropy(inputs, target, 1.0) + self._cross_entropy(inputs, output, 0.0))

    def _cross_entropy(self, inputs: LossInputs, light: Tensor, label: float) -> Tensor:
        assert inputs.condition is not None
        logits = self.network(inputs.condition[:, :FEATURES], light)
        return functional.binary_cross_entropy_with_logits(logits, torch.full_like(logits, label))


def light_maps(inputs: LossInputs) -> tuple[Tensor, Tensor]:
    """Direct and indirect light / albedo of network and reference on the scale of Tanh; -1 in the sky."""
    assert inputs.condition is not None
    direct, unit = torch.split(inputs.condition[:, FEATURES:], [COLORS, 1], dim=1)
    output, target = (to_tanh((x / unit + direct) * inputs.surface_mask) for x in (inputs.output, inputs.target))
    return output, target
