"""What losses compare, and in which scale.

Light has no upper end: SSIM's constants and an L1 norm would see highlights alone. So every term compares ``tone``d
light, the μ-law of Kalantari and Ramamoorthi 2017 (Deep High Dynamic Range Imaging of Dynamic Scenes, eq. 5) applied to
radiance in means of the frame: nearly linear below 1/μ, 1 at the mean, logarithmic beyond.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

MU = 16.0


@dataclass(frozen=True)
class LossInputs:
    """What a loss compares; light is radiance / albedo in means of the current frame.

    Attributes
    ----------
    output, target : Tensor, shape (B, 3, h, w)
        (B, 6, h, w) for what shades an environment: diffuse, specular.
    warped : Tensor or None, shape (B, 3, h, w)
        The network's output for the previous frame, moved to where its surfaces are now; for losses that ask for it.
    seen : Tensor, shape (B, 1, h, w)
        1 where there is a surface, 0 in the sky.
    visible : Tensor or None, shape (B, 1, h, w)
        1 where the previous frame shows the same surface; there where ``warped`` is.
    condition : Tensor or None, shape (B, K, h, w)
        What the network's ``condition`` gives for its inputs; for losses that ask for it.
    reflectance : Tensor or None, shape (B, 6, h, w)
        What such diffuse and specular light is multiplied by in the picture.
    """

    output: Tensor
    target: Tensor
    warped: Tensor | None
    seen: Tensor
    visible: Tensor | None
    condition: Tensor | None = None
    reflectance: Tensor | None = None


def tone(light: Tensor) -> Tensor:
    """log(1 + μ x) / log(1 + μ), in single precision."""
    return torch.log1p(MU * light.float().clamp(min=0)) / math.log1p(MU)


def toned(views: LossInputs) -> tuple[Tensor, Tensor]:
    """Output and target as losses compare them; 0 in the sky."""
    return tone(views.output) * views.seen, tone(views.target) * views.seen


def warp(previous: Tensor, motion: Tensor) -> Tensor:
    """``previous`` [B, C, h, w] seen from the current frame, bilinear; motion [B, 2, h, w] in texels."""
    h, w = previous.shape[2:]
    y, x = torch.meshgrid(torch.arange(h, device=motion.device), torch.arange(w, device=motion.device), indexing="ij")
    size = torch.tensor([w, h], dtype=motion.dtype, device=motion.device)
    at = (torch.stack([x, y], -1) - motion.permute(0, 2, 3, 1) + 0.5) / size * 2 - 1
    return functional.grid_sample(previous, at, padding_mode="border", align_corners=False)


def mean_where(values: Tensor, mask: Tensor) -> Tensor:
    """Mean of ``values`` [B, C, h, w] over texels where ``mask`` [B, 1, h, w] is 1; 0 where it is so nowhere."""
    return (values * mask).sum() / (mask.sum() * values.shape[1]).clamp(min=1)
