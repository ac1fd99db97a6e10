"""GFA's loss (Gai et al. 2025): smooth L1, VGG features and a discriminator; SSIM can replace the features."""

from itertools import pairwise
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.parametrizations import spectral_norm

from export.training.losses.bcnn import ssim_map
from export.training.losses.loss_inputs import LossInputs, masked_mean, tone_map_pair
from export.training.losses.perceptual import Perceptual

BETA = 0.1  # tone-mapped difference beyond which smooth L1 is linear; the paper does not give it
NEGATIVE_SLOPE = 0.2  # of LeakyReLU


class GfaLoss:
    """0.7 smooth L1 + 0.28 perceptual + 0.02 adversarial.

    Parameters
    ----------
    smooth_l1, perceptual, adversarial, ssim : float
        Weights; terms of weight 0 are not computed. SSIM is not part of the paper's loss; it can replace the
        perceptual term.
    features : str or None
        File of the VGG network for the perceptual term, which is left out without it.

    Attributes
    ----------
    discriminator : PatchDiscriminator or None
        The discriminator that is trained with the network.

    Raises
    ------
    ValueError
        Unless ``smooth_l1`` is positive and the other weights are not negative.
    """

    uses_previous = uses_condition = False

    def __init__(self, smooth_l1: float = 0.7, perceptual: float = 0.28, adversarial: float = 0.02,
                 ssim: float = 0.0, features: str | None = None) -> None:
        if not (float(smooth_l1) > 0 and all(float(x) >= 0 for x in (perceptual, adversarial, ssim))):
            raise ValueError(f"weights {smooth_l1}, {perceptual}, {adversarial}, {ssim}: only the first must not be 0")
        self.smooth_l1, self.perceptual, self.adversarial, self.ssim = smooth_l1, perceptual, adversarial, ssim
        self.network = Perceptual(Path(features)) if features is not None and perceptual > 0 else None
        self.discriminator = PatchDiscriminator() if adversarial > 0 else None

    def __call__(self, inputs: LossInputs) -> dict[str, Tensor]:
        a, b = tone_map_pair(inputs)
        smooth_l1 = functional.smooth_l1_loss(a, b, reduction="none", beta=BETA)
        terms = {"smooth_l1": self.smooth_l1 * masked_mean(smooth_l1, inputs.surface_mask)}
        if self.ssim > 0:
            terms["ssim"] = self.ssim * (1 - masked_mean(ssim_map(a, b), inputs.surface_mask))
        if self.network is not None:
            terms["perceptual"] = self.perceptual * self.network(a, b)
        if self.discriminator is not None:
            terms["adversarial"] = self.adversarial * self.discriminator.generator_loss(inputs)
        return terms


class PatchDiscriminator(nn.Module):
    """PatchGAN (Isola et al. 2017, "Image-to-Image Translation with Conditional Adversarial Networks").

    Each output sees 34×34 texels: it has two halvings instead of three, since the grids are small. Spectral
    normalization (Miyato et al. 2018) replaces batch norm and limits the discriminator's strength; the least-squares
    loss (Mao et al. 2017) avoids saturation.
    """

    def __init__(self, width: int = 32) -> None:
        super().__init__()
        widths, strides = (1, width, 2 * width, 4 * width, 1), (2, 2, 1, 1)
        layers: list[nn.Module] = []
        for (inputs, outputs), stride in zip(pairwise(widths), strides, strict=True):
            layers += [spectral_norm(nn.Conv2d(inputs, outputs, 4, stride, padding=1)), nn.LeakyReLU(NEGATIVE_SLOPE)]
        self.layers = nn.Sequential(*layers[:-1])

    def forward(self, light: Tensor) -> Tensor:
        """Score of each patch of tone-mapped ``light`` [B, 3, h, w], 1 for real: [B × 3, 1, h / 4 − 2, w / 4 − 2]."""
        return torch.as_tensor(self.layers(light.flatten(0, 1).unsqueeze(1)))

    def generator_loss(self, inputs: LossInputs) -> Tensor:
        """The adversarial loss of the network."""
        return (self(tone_map_pair(inputs)[0]) - 1).square().mean()

    def discriminator_loss(self, inputs: LossInputs) -> Tensor:
        """The loss of the discriminator itself."""
        output, target = tone_map_pair(inputs)
        return 0.5 * ((self(target) - 1).square().mean() + self(output).square().mean())
