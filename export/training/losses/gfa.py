"""GFA's loss (Gai et al. 2025): smooth L1, features of a VGG, and a discriminator; or SSIM where no VGG is at hand."""

from __future__ import annotations

from pathlib import Path

from torch import Tensor
from torch.nn import functional

from export.training.losses.bcnn import ssim_map
from export.training.losses.discriminator import PatchDiscriminator
from export.training.losses.loss_inputs import LossInputs, mean_where, toned
from export.training.losses.perceptual import Perceptual

BETA = 0.1  # toned difference from which on smooth L1 is linear; the paper names none


class GfaLoss:
    """0.7 smooth L1 + 0.28 perceptual + 0.02 adversarial.

    Parameters
    ----------
    smooth_l1, perceptual, adversarial, ssim : float
        Weights; of the others' terms nothing is worked out where theirs is 0. SSIM is not the paper's: it compares
        structure in the place of the perceptual term.
    features : str or None
        File of the network whose features the perceptual term compares. Without one that term is left out.

    Attributes
    ----------
    discriminator : PatchDiscriminator or None
        To be trained along.

    Raises
    ------
    ValueError
        For a weight that is not above 0, or below it for the others than the first.
    """

    uses_previous = uses_condition = False

    def __init__(self, smooth_l1: float = 0.7, perceptual: float = 0.28, adversarial: float = 0.02,
                 ssim: float = 0.0, features: str | None = None) -> None:
        if not (float(smooth_l1) > 0 and all(float(x) >= 0 for x in (perceptual, adversarial, ssim))):
            raise ValueError(f"weights {smooth_l1}, {perceptual}, {adversarial}, {ssim}")
        self.smooth_l1, self.perceptual, self.adversarial, self.ssim = smooth_l1, perceptual, adversarial, ssim
        self.network = Perceptual(Path(features)) if features is not None and perceptual > 0 else None
        self.discriminator = PatchDiscriminator() if adversarial > 0 else None

    def __call__(self, views: LossInputs) -> dict[str, Tensor]:
        a, b = toned(views)
        terms = {"smooth_l1": self.smooth_l1 * mean_where(
            functional.smooth_l1_loss(a, b, reduction="none", beta=BETA), views.seen)}
        if self.ssim > 0:
            terms["ssim"] = self.ssim * (1 - mean_where(ssim_map(a, b), views.seen))
        if self.network is not None:
            terms["perceptual"] = self.perceptual * self.network(a, b)
        if self.discriminator is not None:
            terms["adversarial"] = self.adversarial * self.discriminator.fooled(views)
        return terms
