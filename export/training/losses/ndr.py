"""NDR's loss (Suppan et al.): structural dissimilarity of both kinds of light, and of the picture that they make."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from export.training.losses.bcnn import ssim_map
from export.training.losses.loss_inputs import LossInputs, mean_where


@dataclass(frozen=True)
class NdrLoss:
    """DSSIM = (1 - SSIM) / 2 of diffuse light, specular light and the picture, each on Reinhard's curve x / (1 + x).

    Attributes
    ----------
    diffuse, specular, final : float
        Weights of DSSIM.
    l1 : float
        Weight of the mean difference on the same curve, of diffuse and specular light, which is not the paper's.
    """

    diffuse: float = 1.0
    specular: float = 1.0
    final: float = 1.0
    l1: float = 0.0

    discriminator = None
    uses_condition = False
    uses_previous = False

    def __call__(self, views: LossInputs) -> dict[str, Tensor]:
        assert views.reflectance is not None
        made, true = (_pictures(light * views.seen, views.reflectance) for light in (views.output, views.target))
        terms = {name: getattr(self, name) * mean_where((1 - ssim_map(made[name], true[name])) / 2, views.seen)
                 for name in made}
        if self.l1 > 0:
            apart = (reinhard(views.output) - reinhard(views.target)).abs()
            terms["l1"] = self.l1 * mean_where(apart, views.seen)
        return terms


def _pictures(light: Tensor, reflectance: Tensor) -> dict[str, Tensor]:
    """Diffuse and specular light [B, 6, h, w], and what they make with the surface's reflectances, each toned."""
    diffuse, specular = light.chunk(2, dim=1)
    albedo, mirrored = reflectance.chunk(2, dim=1)
    return {"diffuse": reinhard(diffuse), "specular": reinhard(specular),
            "final": reinhard(diffuse * albedo + specular * mirrored)}


def reinhard(light: Tensor) -> Tensor:
    """Reinhard's curve, in single precision."""
    light = light.float().clamp(min=0)
    return light / (1 + light)
