"""NDR's loss (Suppan et al.): structural dissimilarity of both kinds of light, and of the image that they make."""

from dataclasses import dataclass

from torch import Tensor

from export.training.losses.bcnn import ssim_map
from export.training.losses.loss_inputs import LossInputs, masked_mean


@dataclass(frozen=True)
class NdrLoss:
    """DSSIM = (1 - SSIM) / 2 of diffuse light, specular light and the final image, on Reinhard's curve x / (1 + x).

    Attributes
    ----------
    diffuse, specular, final : float
        Weights of DSSIM.
    l1 : float
        Weight of the mean absolute difference of diffuse and specular light on the same curve, which is not part of
        the paper's loss.
    """

    diffuse: float = 1.0
    specular: float = 1.0
    final: float = 1.0
    l1: float = 0.0

    discriminator = None
    uses_condition = False
    uses_previous = False

    def __call__(self, inputs: LossInputs) -> dict[str, Tensor]:
        assert inputs.reflectance is not None
        mask = inputs.surface_mask
        output, target = (_tone_map_layers(x * mask, inputs.reflectance) for x in (inputs.output, inputs.target))
        terms = {name: getattr(self, name) * masked_mean((1 - ssim_map(output[name], target[name])) / 2, mask)
                 for name in output}
        if self.l1 > 0:
            difference = (reinhard(inputs.output) - reinhard(inputs.target)).abs()
            terms["l1"] = self.l1 * masked_mean(difference, mask)
        return terms


def _tone_map_layers(light: Tensor, reflectance: Tensor) -> dict[str, Tensor]:
    """Tone-mapped diffuse light, specular light and final image; ``light`` and ``reflectance`` are [B, 6, h, w]."""
    diffuse, specular = light.chunk(2, dim=1)
    albedo, specular_reflectance = reflectance.chunk(2, dim=1)
    return {"diffuse": reinhard(diffuse), "specular": reinhard(specular),
            "final": reinhard(diffuse * albedo + specular * specular_reflectance)}


def reinhard(light: Tensor) -> Tensor:
    """Reinhard's curve, in single precision."""
    light = light.float().clamp(min=0)
    return light / (1 + light)
