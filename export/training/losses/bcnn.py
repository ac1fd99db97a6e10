"""BCNN's loss (Xin et al. 2021): structure, edges, and steadiness over time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from export.training.losses.loss_inputs import LossInputs, mean_where, tone, toned

WINDOW_SIGMA, WINDOW_RADIUS = 1.5, 5  # of SSIM; Wang et al. 2004
K1, K2 = 0.01, 0.03


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

    discriminator = None
    uses_condition = False

    @property
    def uses_previous(self) -> bool:
        return self.temporal > 0

    def __call__(self, views: LossInputs) -> dict[str, Tensor]:
        a, b = toned(views)
        inside = 1 - functional.max_pool2d(1 - views.seen, 3, stride=1, padding=1)  # the sky's edge is no detail
        terms: dict[str, Callable[[], Tensor]] = {
            "ssim": lambda: 1 - mean_where(ssim_map(a, b), views.seen),
            "laplacian": lambda: mean_where((laplacian(a) - laplacian(b)).abs(), inside),
            "temporal": lambda: _change(a, views),
            "l1": lambda: mean_where((a - b).abs(), views.seen),
        }
        return {name: getattr(self, name) * term() for name, term in terms.items() if getattr(self, name) > 0}


def _change(a: Tensor, views: LossInputs) -> Tensor:
    assert views.warped is not None and views.visible is not None
    return mean_where((a - tone(views.warped)).abs(), views.seen * views.visible)


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
