"""What training minimises.

Light has no upper end: SSIM's constants and an L1 norm would see highlights alone. So every term compares ``tone``d
light, the μ-law of Kalantari and Ramamoorthi 2017 (Deep High Dynamic Range Imaging of Dynamic Scenes, eq. 5) applied to
radiance in means of the frame: nearly linear below 1/μ, 1 at the mean, logarithmic beyond.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from app.errors import SettingsError

MU = 16.0
WINDOW_SIGMA, WINDOW_RADIUS = 1.5, 5  # of SSIM; Wang et al. 2004
K1, K2 = 0.01, 0.03


@dataclass(frozen=True)
class Views:
    """What a loss compares; light is radiance / albedo in means of the current frame.

    Attributes
    ----------
    output, target : Tensor, shape (B, 3, h, w)
    warped : Tensor, shape (B, 3, h, w)
        The network's output for the previous frame, moved to where its surfaces are now.
    seen : Tensor, shape (B, 1, h, w)
        1 where there is a surface, 0 in the sky.
    visible : Tensor, shape (B, 1, h, w)
        1 where the previous frame shows the same surface.
    """

    output: Tensor
    target: Tensor
    warped: Tensor
    seen: Tensor
    visible: Tensor


Loss = Callable[[Views], dict[str, Tensor]]  # weighted terms by name; training minimises their sum


@dataclass(frozen=True)
class BcnnLoss:
    """BCNN's: 0.7 (1 − SSIM) + 0.1 L1 of the Laplacian + 0.2 L1 to the motion-warped previous output.

    Attributes
    ----------
    ssim, laplacian, temporal, l1 : float
        Weights; L1 to the target is not the paper's and there for ablations.
    """

    ssim: float = 0.7
    laplacian: float = 0.1
    temporal: float = 0.2
    l1: float = 0.0

    def __call__(self, views: Views) -> dict[str, Tensor]:
        a, b = (tone(x) * views.seen for x in (views.output, views.target))
        inside = 1 - functional.max_pool2d(1 - views.seen, 3, stride=1, padding=1)  # the sky's edge is no detail
        terms: dict[str, Callable[[], Tensor]] = {
            "ssim": lambda: 1 - mean_where(ssim_map(a, b), views.seen),
            "laplacian": lambda: mean_where((laplacian(a) - laplacian(b)).abs(), inside),
            "temporal": lambda: mean_where((a - tone(views.warped)).abs(), views.seen * views.visible),
            "l1": lambda: mean_where((a - b).abs(), views.seen),
        }
        return {name: getattr(self, name) * term() for name, term in terms.items() if getattr(self, name) > 0}


LOSSES: Mapping[str, Callable[..., Loss]] = {"bcnn": BcnnLoss}


def make_loss(kind: str, options: Mapping[str, Any]) -> Loss:
    """The loss of that name.

    Raises
    ------
    SettingsError
        When there is none, or it has no such options.
    """
    if kind not in LOSSES:
        raise SettingsError(f"no loss {kind!r}", "loss.kind", f"expected one of {', '.join(LOSSES)}")
    try:
        return LOSSES[kind](**options)
    except TypeError as error:
        raise SettingsError(f"bad options ({error})", f"loss {kind!r}", "expected its weights by name") from None


def tone(light: Tensor) -> Tensor:
    """log(1 + μ x) / log(1 + μ), in single precision."""
    return torch.log1p(MU * light.float().clamp(min=0)) / math.log1p(MU)


def ssim_map(a: Tensor, b: Tensor) -> Tensor:
    """Structural similarity of each texel and channel for values of range 1, shape (B, C, h, w).

    An 11×11 Gaussian window of σ 1.5 that ends at the image's edge.
    """
    moments = torch.cat([a, b, a * a, b * b, a * b], 1)
    mean_a, mean_b, aa, bb, ab = (blurred(moments) / blurred(torch.ones_like(moments[:1, :1]))).chunk(5, dim=1)
    c1, c2 = K1**2, K2**2
    similar = (2 * mean_a * mean_b + c1) * (2 * (ab - mean_a * mean_b) + c2)
    return similar / ((mean_a**2 + mean_b**2 + c1) * ((aa - mean_a**2) + (bb - mean_b**2) + c2))


def blurred(x: Tensor) -> Tensor:
    """SSIM's window over each channel, 0 beyond the image."""
    at = torch.arange(-WINDOW_RADIUS, WINDOW_RADIUS + 1, dtype=x.dtype, device=x.device)
    window = torch.exp(-0.5 * (at / WINDOW_SIGMA) ** 2)
    kernel = (window / window.sum()).reshape(1, 1, -1, 1)
    planes = x.flatten(0, 1).unsqueeze(1)
    planes = functional.conv2d(planes, kernel, padding=(WINDOW_RADIUS, 0))
    planes = functional.conv2d(planes, kernel.transpose(2, 3), padding=(0, WINDOW_RADIUS))
    return planes.reshape(x.shape)


def laplacian(x: Tensor) -> Tensor:
    """Sum of the four neighbours − 4 × the texel, edges repeated."""
    p = functional.pad(x, (1, 1, 1, 1), mode="replicate")
    return p[..., :-2, 1:-1] + p[..., 2:, 1:-1] + p[..., 1:-1, :-2] + p[..., 1:-1, 2:] - 4 * x


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
