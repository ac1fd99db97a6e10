"""Final gathering cleaned by predicted kernels: a few rays a texel in, their light without noise out.

A U-Net writes the logits of four filters, which an edge-avoiding à-trous scheme applies one after the other (Dammertz
et al. 2010, "Edge-Avoiding À-Trous Wavelet Transform for fast Global Illumination Filtering"; kernel prediction: Bako
et al. 2017, "Kernel-Predicting Convolutional Networks for Denoising Monte Carlo Renderings").
"""

import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from app.network.contract import ModelContract, TensorSpec
from export.models.network import EXTENT, NEGATIVE_SLOPE, Network, sanitize

CHANNELS = ("gathered.rgb", "gathered.count", "gathered.distance", "interpolated.rgb", "normal.view.xyz",
            "position.view.xyz")
WIDTHS = (16, 32, 32)    # channels at half, quarter and eighth size
SQUARE = (0, 0), (-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, 1), (1, -1), (-1, 1)  # taps, the middle one first
TAPS = len(SQUARE)
CORNERS = 4  # texels of 2×2
STEPS = 8, 4, 2, 1  # texels between the taps of each kernel
# A prior that the logits are added to: minus
NORMAL_WEIGHT = 16.0   # times 1 - the cosine between the normals,
PLANE_SIGMA = 0.02     # and the squared distance from the texel's plane, in units of this share of the depth,
MAX_LOGIT = 12.0
MIN_EXPONENT, MAX_EXPONENT = -40.0, 30.0
MIN_COUNT = 1e-3       # of rays, so that its logarithm is finite
MIN_WEIGHT = 1e-30     # so that nothing divides by 0
MAX_COUNT = 64.0       # of rays, that features tell apart; training has fewer
MIN_DEPTH = 1e-3       # in the unit of EXTENT
INTERPOLATED_BIAS = -2.0  # logit of the share of interpolated light before training


class FinalGather(Network):
    """A U-Net whose kernels average gathered light, blended with light that is interpolated between surfels.

    The output is a weighted mean of its inputs' light: it creates no energy, and is linear in light for given weights.
    The weights depend on light only relative to the mean of the frame. Texels without rays get the light of those
    around.
    """

    def __init__(self) -> None:
        super().__init__()
        self.contract = ModelContract(
            name="final-gather", paper="final gathering, with kernels as in Bako et al. 2017; docs/lighting.md",
            inputs={"screen": TensorSpec(CHANNELS)}, outputs={"indirect": TensorSpec(("indirect.rgb",))}, scale=1 / 4,
            multiple_of=8, exposure="mean-radiance", bounces="multi", scene_extent=EXTENT, licence="MIT")
        half, quarter, eighth = WIDTHS
        features = 3 + 1 + 1 + 3 + 3 + 1
        self.down = nn.ModuleList([_conv(4 * features, half), _conv(half, quarter), _conv(quarter, eighth)])
        self.up = nn.ModuleList([_conv(eighth + quarter, quarter), _conv(quarter + half, half)])
        self.last = nn.Conv2d(half, 4 * (len(STEPS) * TAPS + 1), 1)
        self.count_power = nn.Parameter(torch.ones(1))  # of a texel's rays, by which it counts
        self.centre_power = nn.Parameter(torch.zeros(len(STEPS)))  # of its rays, by which it counts for itself
        for parameter in self.last.parameters():  # so that training starts with the prior alone
            nn.init.zeros_(parameter)

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
        screen = sanitize(screen, self.contract.inputs["screen"])
        gathered, count, distance, interpolated, normal, position = torch.split(screen, [3, 1, 1, 3, 3, 3], dim=1)
        surface = (normal.square().sum(1, keepdim=True) > 0).to(screen)
        depth = -position[:, 2:]
        rays = (count.clamp(max=MAX_COUNT) + MIN_COUNT).log2()
        features = torch.cat([gathered.log1p(), rays / 6, distance, interpolated.log1p(), normal,
                              depth.clamp(min=MIN_DEPTH).log2() / 4], 1) * surface
        logits = self._predict(features).clamp(-MAX_LOGIT, MAX_LOGIT)
        share = torch.sigmoid(logits[:, -1:] + INTERPOLATED_BIAS)
        light = gathered + share * (interpolated - gathered)
        weight = (self.count_power * math.log(2) * rays).exp() * surface
        own = (count + 1).log()
        for index, step in enumerate(STEPS):
            kernel = logits[:, index * TAPS:(index + 1) * TAPS]
            light, weight = filter_light(light, normal, position, weight, kernel, self.centre_power[index] * own, step)
        return light * surface

    def _predict(self, features: Tensor) -> Tensor:
        x, skips = fold(features), []
        for level, convolution in enumerate(self.down):
            x = functional.leaky_relu(convolution(functional.avg_pool2d(x, 2) if level else x), NEGATIVE_SLOPE)
            skips.append(x)
        for convolution, skip in zip(self.up, skips[-2::-1], strict=True):
            x = torch.cat([functional.interpolate(x, scale_factor=2.0), skip], 1)
            x = functional.leaky_relu(convolution(x), NEGATIVE_SLOPE)
        return spread(self.last(x))


def filter_light(light: Tensor, normal: Tensor, position: Tensor, weight: Tensor, logits: Tensor, own: Tensor,
                 step: int) -> tuple[Tensor, Tensor]:
    """Weighted mean of the light of the texels ``step`` away from each one, and of their weights.

    Parameters
    ----------
    light, normal, position : Tensor, shape (B, 3, h, w)
    weight : Tensor, shape (B, 1, h, w)
        How much each texel counts.
    logits : Tensor, shape (B, ``TAPS``, h, w)
        Added to the prior of each texel's neighbours.
    own : Tensor, shape (B, 1, h, w)
        Added to the logit of the texel itself.
    """
    cosine = _dot(neighbours(normal, step), normal)
    axis = normal / (PLANE_SIGMA * (-position[:, 2:]).clamp(min=MIN_DEPTH))
    plane = _dot(neighbours(position, step), axis) - (position * axis).sum(1, keepdim=True)
    exponent = logits + NORMAL_WEIGHT * (cosine - 1) - plane.square()
    exponent = torch.cat([exponent[:, :1] + own, exponent[:, 1:]], 1)
    kernel = exponent.clamp(MIN_EXPONENT, MAX_EXPONENT).exp()
    sums = _sum_taps(neighbours(torch.cat([light * weight, weight], 1), step) * kernel.unsqueeze(1))
    return sums[:, :3] / (sums[:, 3:] + MIN_WEIGHT), sums[:, 3:] / _sum_taps(kernel.unsqueeze(1))


def neighbours(x: Tensor, step: int) -> Tensor:
    """The texels ``step`` away from each one as in ``SQUARE``, shape (B, C, ``TAPS``, h, w); 0 beyond the image."""
    height, width = x.shape[2:]
    padded = functional.pad(x, (step,) * 4)
    return torch.stack([padded[:, :, step * (1 + down):step * (1 + down) + height,
                               step * (1 + right):step * (1 + right) + width] for right, down in SQUARE], 2)


def fold(x: Tensor) -> Tensor:
    """``pixel_unshuffle`` by 2: (B, C, 2 h, 2 w) to (B, 4 C, h, w); in onnxruntime faster as a convolution."""
    channels = int(x.shape[1])
    return functional.conv2d(x, _corners(channels, x), stride=2, groups=channels)


def spread(x: Tensor) -> Tensor:
    """``pixel_shuffle`` by 2, the inverse of ``fold``."""
    channels = int(x.shape[1]) // CORNERS
    return functional.conv_transpose2d(x, _corners(channels, x), stride=2, groups=channels)


def _corners(channels: int, like: Tensor) -> Tensor:
    """Kernels [4 · channels, 1, 2, 2] that each select one texel of 2×2."""
    return torch.eye(CORNERS, dtype=like.dtype).reshape(CORNERS, 1, 2, 2).repeat(channels, 1, 1, 1)


def _sum_taps(x: Tensor) -> Tensor:
    """Sum over ``TAPS`` of [B, C, ``TAPS``, h, w]; in onnxruntime faster as a convolution."""
    channels = int(x.shape[1])
    return functional.conv2d(x.flatten(1, 2), x.new_ones(channels, TAPS, 1, 1), groups=channels)


def _dot(x: Tensor, y: Tensor) -> Tensor:
    """Products of the vectors at all taps, [B, 3, ``TAPS``, h, w], with [B, 3, h, w]."""
    a, b, c = (x * y.unsqueeze(2)).unbind(1)
    return a + b + c


def _conv(inputs: int, outputs: int) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, padding=1)
