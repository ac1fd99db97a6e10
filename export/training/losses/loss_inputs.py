"""Inputs of the losses, and the tone mapping under which they compare light.

Light is unbounded, so SSIM's constants do not fit and highlights would dominate an L1 norm. The terms therefore compare
tone-mapped light: radiance relative to the mean of the frame under the μ-law of Kalantari and Ramamoorthi 2017 ("Deep
High Dynamic Range Imaging of Dynamic Scenes", eq. 5), which is nearly linear below 1/μ, 1 at the mean and logarithmic
beyond.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

MU = 16.0


@dataclass(frozen=True)
class LossInputs:
    """Inputs of a loss; light is radiance / albedo relative to the mean of the current frame.

    Attributes
    ----------
    output, target : Tensor, shape (B, 3, h, w)
        (B, 6, h, w) for networks that shade an environment: diffuse, specular.
    warped : Tensor or None, shape (B, 3, h, w)
        The network's output for the previous frame, warped to the current one, for losses that use it.
    surface_mask : Tensor, shape (B, 1, h, w)
        1 on surfaces, 0 in the sky.
    history_mask : Tensor or None, shape (B, 1, h, w)
        1 where the previous frame shows the same surface; given with ``warped``.
    condition : Tensor or None, shape (B, K, h, w)
        Result of the network's ``condition``, for losses that use it.
    reflectance : Tensor or None, shape (B, 6, h, w)
        Factors of diffuse and specular light in the final image.
    """

    output: Tensor
    target: Tensor
    warped: Tensor | None
    surface_mask: Tensor
    history_mask: Tensor | None
    condition: Tensor | None = None
    reflectance: Tensor | None = None


def tone_map(light: Tensor) -> Tensor:
    """log(1 + μ x) / log(1 + μ), in single precision."""
    return torch.log1p(MU * light.float().clamp(min=0)) / math.log1p(MU)


def tone_map_pair(inputs: LossInputs) -> tuple[Tensor, Tensor]:
    """Tone-mapped output and target; 0 in the sky."""
    return tone_map(inputs.output) * inputs.surface_mask, tone_map(inputs.target) * inputs.surface_mask


def warp(previous: Tensor, motion: Tensor) -> Tensor:
    """Warp ``previous`` [B, C, h, w] to the current frame, bilinearly; ``motion`` [B, 2, h, w] in texels."""
    h, w = previous.shape[2:]
    y, x = torch.meshgrid(torch.arange(h, device=motion.device), torch.arange(w, device=motion.device), indexing="ij")
    size = torch.tensor([w, h], dtype=motion.dtype, device=motion.device)
    at = (torch.stack([x, y], -1) - motion.permute(0, 2, 3, 1) + 0.5) / size * 2 - 1
    return functional.grid_sample(previous, at, padding_mode="border", align_corners=False)


def masked_mean(values: Tensor, mask: Tensor) -> Tensor:
    """Mean of ``values`` [B, C, h, w] over texels where ``mask`` [B, 1, h, w] is 1; 0 for an empty mask."""
    return (values * mask).sum() / (mask.sum() * values.shape[1]).clamp(min=1)
