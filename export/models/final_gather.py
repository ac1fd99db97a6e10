"""Final gathering cleaned by predicted kernels: a few rays a texel in, their light without noise out.

A U-Net writes the logits of four filters, which an edge-avoiding à-trous scheme applies one after the other (Dammertz
et al. 2010, "Edge-Avoiding À-Trous Wavelet Transform for fast Global Illumination Filtering"; kernel prediction: Bako
et al. 2017, "Kernel-Predicting Convolutional Networks for Denoising Monte Carlo Renderings").
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from app.network.contract import ModelContract, TensorSpec
from export.models.edge_avoiding import AROUND, MIN_DEPTH, filter_light, surfaces_of
from export.models.local_mean import keep_local_mean
from export.models.network import EXTENT, NEGATIVE_SLOPE, Network, sanitize

CHANNELS = ("gathered.rgb", "gathered.count", "gathered.distance", "interpolated.rgb", "normal.view.xyz",
            "position.view.xyz")
WIDTHS = (16, 32, 32)    # channels at half, quarter and eighth size
TAPS = 1 + len(AROUND)
FEATURES = 12  # light and the number of its rays, the distance of their ends, interpolated light, normal, depth
CORNERS = 4  # texels of 2×2
STEPS = 8, 4, 2, 1  # texels between the taps of each kernel; no longer than the smallest grid
OUTPUTS = len(STEPS) * TAPS + 1  # logits of all taps, and of the share of interpolated light
MAX_LOGIT = 12.0
MIN_COUNT = 1e-3       # of rays, so that its logarithm is finite
MIN_WEIGHT = 1e-30     # so that nothing divides by 0
MAX_COUNT = 32.0       # of rays, that features tell apart; training has no more
INTERPOLATED_BIAS = -2.0  # logit of the share of interpolated light before training


@dataclass(frozen=True)
class Texels:
    """The network's input, each of shape (B, C, h, w).

    Attributes
    ----------
    rays : Tensor
        log2 of their number, ``count``, up to ``MAX_COUNT``.
    surface : Tensor
        1 on surfaces, 0 in the sky.
    """

    gathered: Tensor
    count: Tensor
    rays: Tensor
    distance: Tensor
    interpolated: Tensor
    normal: Tensor
    position: Tensor
    surface: Tensor


class FinalGather(Network):
    """A U-Net whose kernels average gathered light, blended with light that is interpolated between surfels.

    The output is a weighted mean of its inputs' light, times a ratio that keeps the local mean. Weights and ratio
    depend on light only relative to the mean of the frame. Texels without rays get the light of those around.

    Attributes
    ----------
    body : Module
        Makes ``widths[0]`` channels at half of the grid, from the features and the surface there.
    reads_prior : bool
        Whether it reads interpolated light; False for ablations.
    """

    paper = "final gathering, with kernels as in Bako et al. 2017; docs/lighting.md"

    def __init__(self, name: str = "final-gather", widths: Sequence[int] = WIDTHS, reads_prior: bool = True) -> None:
        super().__init__()
        self.reads_prior = reads_prior
        self.contract = ModelContract(
            name=name, paper=self.paper,
            inputs={"screen": TensorSpec(CHANNELS)}, outputs={"indirect": TensorSpec(("indirect.rgb",))}, scale=1 / 4,
            multiple_of=8, exposure="mean-radiance", bounces="multi", scene_extent=EXTENT, licence="MIT")
        self.body = self._make_body(CORNERS * FEATURES, widths)
        self.last = nn.Conv2d(widths[0], CORNERS * OUTPUTS, 1)
        self.count_power = nn.Parameter(torch.ones(1))  # of a texel's rays, by which it counts
        self.centre_power = nn.Parameter(torch.zeros(len(STEPS)))  # of its rays, by which it counts for itself
        for parameter in self.last.parameters():  # so that training starts with the prior alone
            nn.init.zeros_(parameter)

    def _make_body(self, inputs: int, widths: Sequence[int]) -> nn.Module:
        return UNet(inputs, widths)

    def forward(self, screen: Tensor) -> Tensor:
        """Clean one batch of frames.

        Parameters
        ----------
        screen : Tensor, float32, shape (B, 14, h, w)
            The contract's channels; radiance relative to the mean of the frame; h and w multiples of 8.

        Returns
        -------
        Tensor, float32, shape (B, 3, h, w)
            Indirect radiance / albedo; 0 in the sky.
        """
        texels = self._read(sanitize(screen, self.contract.inputs["screen"]))
        surface = texels.surface
        depth = -texels.position[:, 2:]
        features = torch.cat([texels.gathered.log1p(), texels.rays / 6, texels.distance, texels.interpolated.log1p(),
                              texels.normal, depth.clamp(min=MIN_DEPTH).log2() / 4], 1) * surface
        light = self._light(self.body(fold(features), fold(surface)), texels) * surface
        return keep_local_mean(light, texels.gathered, texels.count, texels.normal, texels.position)

    def _read(self, screen: Tensor) -> Texels:
        gathered, count, distance, interpolated, normal, position = torch.split(screen, [3, 1, 1, 3, 3, 3], dim=1)
        surface = (normal.square().sum(1, keepdim=True) > 0).to(screen)
        rays = (count.clamp(max=MAX_COUNT) + MIN_COUNT).log2()
        return Texels(gathered, count, rays, distance, interpolated if self.reads_prior else gathered, normal, position,
                      surface)

    def _light(self, x: Tensor, texels: Texels) -> Tensor:
        """Light [B, 3, h, w] by kernels from what the body made."""
        *logits, (share,) = self._logits(x, [TAPS] * len(STEPS) + [1])
        share = torch.sigmoid(share + INTERPOLATED_BIAS)
        light = texels.gathered + share * (texels.interpolated - texels.gathered)
        weight = (self.count_power * math.log(2) * texels.rays).exp() * texels.surface
        lit = torch.cat([light * weight, weight], 1)
        own, surfaces = (texels.count + 1).log(), surfaces_of(texels.normal, texels.position)
        for index, step in enumerate(STEPS):
            middle, *around = logits[index]
            lit = filter_light(lit, surfaces, middle + self.centre_power[index] * own, around, step)
        return lit[:, :3] / (lit[:, 3:] + MIN_WEIGHT)

    def _logits(self, x: Tensor, groups: Sequence[int]) -> list[tuple[Tensor, ...]]:
        """Logits on the grid, each of shape (B, 1, h, w), in groups of these lengths; ``OUTPUTS`` in all."""
        # ``last`` and the shuffle of 2×2 texels are one convolution, faster in onnxruntime if of few outputs at a time.
        # Each of the four texels has its bias, which is the weight of one more channel, of 1.
        x = torch.cat([x, torch.ones_like(x[:, :1])], 1)
        weights = torch.cat([part.reshape(CORNERS * OUTPUTS, -1) for part in self.last.parameters()], 1)
        weights = weights.reshape(OUTPUTS, 2, 2, -1).permute(3, 0, 1, 2)
        predicted = [functional.conv_transpose2d(x, part, stride=2) for part in torch.split(weights, list(groups), 1)]
        return [torch.split(x.clamp(-MAX_LOGIT, MAX_LOGIT), 1, 1) for x in predicted]


class UNet(nn.Module):
    """Three levels with one convolution each, down and up."""

    def __init__(self, inputs: int, widths: Sequence[int]) -> None:
        super().__init__()
        a, b, c = widths
        self.down = nn.ModuleList([conv(inputs, a), conv(a, b), conv(b, c)])
        self.up = nn.ModuleList([conv(c + b, b), conv(b + a, a)])

    def forward(self, x: Tensor, surface: Tensor) -> Tensor:
        skips: list[Tensor] = []
        for level, convolution in enumerate(self.down):
            x = functional.leaky_relu(convolution(functional.avg_pool2d(x, 2) if level else x), NEGATIVE_SLOPE)
            skips.append(x)
        for convolution, skip in zip(self.up, skips[-2::-1], strict=True):
            x = torch.cat([functional.interpolate(x, scale_factor=2.0), skip], 1)
            x = functional.leaky_relu(convolution(x), NEGATIVE_SLOPE)
        return x


def fold(x: Tensor) -> Tensor:
    """``pixel_unshuffle`` by 2: (B, C, 2 h, 2 w) to (B, 4 C, h, w); in onnxruntime faster as a convolution."""
    channels = int(x.shape[1])
    return functional.conv2d(x, _corners(channels, x), stride=2, groups=channels)


def _corners(channels: int, like: Tensor) -> Tensor:
    """Kernels [4 · channels, 1, 2, 2] that each select one texel of 2×2."""
    return torch.eye(CORNERS, dtype=like.dtype, device=like.device).reshape(CORNERS, 1, 2, 2).repeat(channels, 1, 1, 1)


def conv(inputs: int, outputs: int) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, padding=1)
