"""BCNN's loss (Xin et al. 2021): structure, edges and temporal stability."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from export.training.losses.loss_inputs import LossInputs, masked_mean, tone_map, tone_map_pair

WINDOW_SIGMA, WINDOW_RADIUS = 1.5, 5  # of SSIM; Wang et al. 2004
K1, K2 = 0.01, 0.03


@dataclass(frozen=True)
class BcnnLoss:
    """0.7 (1 − SSIM) + 0.1 L1 of the Laplacian + 0.2 L1 to the motion-warped previous output.

    Attributes
    ----------
    ssim, laplacian, temporal, l1 : float
        Weights. L1 to the target is not part of the paper's loss; it is for ablations.
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

    def __call__(self, inputs: LossInputs) -> dict[str, Tensor]:
        a, b = tone_map_pair(inputs)
        # Without silhouettes against the sky.
        inside = 1 - functional.max_pool2d(1 - inputs.surface_mask, 3, stride=1, padding=1)
        terms: dict[str, Callable[[], Tensor]] = {
            "ssim": lambda: 1 - masked_mean(ssim_map(a, b), inputs.surface_mask),
            "laplacian": lambda: masked_mean((laplacian(a) - laplacian(b)).abs(), inside),
            "temporal": lambda: _temporal_difference(a, inputs),
            "l1": lambda: masked_mean((a - b).abs(), inputs.surface_mask),
        }
        return {name: getattr(self, name) * term() for name, term in terms.items() if getattr(self, name) > 0}


def _temporal_difference(a: Tensor, inputs: LossInputs) -> Tensor:
    assert inputs.warped is not None and inputs.history_mask is not None
    return masked_mean((a - tone_map(inputs.warped)).abs(), inputs.surface_mask * inputs.history_mask)


def ssim_map(a: Tensor, b: Tensor) -> Tensor:
    """Structural similarity of each texel and channel for values of range 1, shape (B, C, h, w).

    An 11×11 Gaussian window of σ 1.5, cut off at the edges of the image.
    """
    moments = torch.cat([a, b, a * a, b * b, a * b], 1)
    mean_a, mean_b, aa, bb, ab = (blur(moments) / blur(torch.ones_like(moments[:1, :1]))).chunk(5, dim=1)
    c1, c2 = K1**2, K2**2
    similarity = (2 * mean_a * mean_b + c1) * (2 * (ab - mean_a * mean_b) + c2)
    return similarity / ((mean_a**2 + mean_b**2 + c1) * ((aa - mean_a**2) + (bb - mean_b**2) + c2))


def blur(x: Tensor) -> Tensor:
    """Convolve each channel with SSIM's window, with zero padding."""
    at = torch.arange(-WINDOW_RADIUS, WINDOW_RADIUS + 1, dtype=x.dtype, device=x.device)
    window = torch.exp(-0.5 * (at / WINDOW_SIGMA) ** 2)
    kernel = (window / window.sum()).reshape(1, 1, -1, 1)
    planes = x.flatten(0, 1).unsqueeze(1)
    planes = functional.conv2d(planes, kernel, padding=(WINDOW_RADIUS, 0))
    planes = functional.conv2d(planes, kernel.transpose(2, 3), padding=(0, WINDOW_RADIUS))
    return planes.reshape(x.shape)


def laplacian(x: Tensor) -> Tensor:
    """Sum of the four neighbours − 4 × the texel, with replicated edges."""
    p = functional.pad(x, (1, 1, 1, 1), mode="replicate")
    return p[..., :-2, 1:-1] + p[..., 2:, 1:-1] + p[..., 1:-1, :-2] + p[..., 1:-1, 2:] - 4 * x
