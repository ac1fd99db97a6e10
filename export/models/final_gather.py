"""Final gathering cleaned by predicted kernels: a few rays a texel in, their light without noise out.

A U-Net writes the logits of three filters, which an edge-avoiding à-trous scheme applies one after the other (Dammertz
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
WIDTHS = (16, 32, 32)  # channels at full, half and quarter size
DILATIONS = (4, 2, 1)
SIDE = 5               # texels along the edge of a kernel
TAPS = SIDE**2
# A prior that the logits are added to: minus
NORMAL_WEIGHT = 16.0   # times 1 - the cosine between the normals,
PLANE_SIGMA = 0.02     # and the squared distance from the texel's plane, in units of this share of the depth,
MAX_LOGIT = 12.0
MIN_EXPONENT, MAX_EXPONENT = -40.0, 30.0
MIN_COUNT = 1e-3       # of rays, so that its logarithm is finite
MIN_DEPTH = 1e-3       # in the unit of EXTENT
INTERPOLATED_BIAS = -2.0  # logit of the share of interpolated light before training


class FinalGather(Network):
    """A U-Net whose kernels average gathered light, blended with light that is interpolated between surfels.

    The output is a weighted mean of its inputs' light: it creates no energy, and is linear in light for given weights.
    The weights depend on light only relative to the mean of the frame.
    """

    def __init__(self) -> None:
        super().__init__()
        self.contract = ModelContract(
            name="final-gather", paper="final gathering, with kernels as in Bako et al. 2017; docs/lighting.md",
            inputs={"screen": TensorSpec(CHANNELS)}, outputs={"indirect": TensorSpec(("indirect.rgb",))}, scale=1 / 8,
            multiple_of=4, exposure="mean-radiance", bounces="multi", scene_extent=EXTENT, licence="MIT")
        full, half, quarter = WIDTHS
        features = 3 + 1 + 1 + 3 + 3 + 1
        self.down = nn.ModuleList([_conv(features, full), _conv(full, half), _conv(half, quarter)])
        self.up = nn.ModuleList([_conv(quarter + half, half), _conv(half + full, full)])
        self.last = nn.Conv2d(full, len(DILATIONS) * TAPS + 1, 1)
        self.count_power = nn.Parameter(torch.ones(len(DILATIONS)))  # of a texel's rays, by which it counts
        for parameter in self.last.parameters():  # so that training starts with the prior alone
            nn.init.zeros_(parameter)

    def forward(self, screen: Tensor) -> Tensor:
        """Clean one batch of frames.

        Parameters
        ----------
        screen : Tensor, float32, shape (B, 14, h, w)
            The contract's channels; radiance relative to the mean of the frame; h and w multiples of 4.

        Returns
        -------
        Tensor, float32, shape (B, 3, h, w)
            Indirect radiance / albedo; 0 in the sky.
        """
        screen = sanitize(screen, self.contract.inputs["screen"])
        gathered, count, distance, interpolated, normal, position = torch.split(screen, [3, 1, 1, 3, 3, 3], dim=1)
        surface = (normal.square().sum(1, keepdim=True) > 0).to(screen)
        depth = -position[:, 2:]
        rays = (count + MIN_COUNT).log2()
        features = torch.cat([gathered.log1p(), rays / 6, distance, interpolated.log1p(), normal,
                              depth.clamp(min=MIN_DEPTH).log2() / 4], 1) * surface
        logits = self._predict(features).clamp(-MAX_LOGIT, MAX_LOGIT)
        for index, dilation in enumerate(DILATIONS):
            weight = self.count_power[index] * math.log(2) * rays + (surface - 1) * 1e3
            gathered = filter_light(gathered, normal, position, weight, logits[:, index * TAPS:(index + 1) * TAPS],
                                    dilation)
        share = torch.sigmoid(logits[:, -1:] + INTERPOLATED_BIAS)
        return (gathered + share * (interpolated - gathered)) * surface

    def _predict(self, x: Tensor) -> Tensor:
        skips = []
        for level, convolution in enumerate(self.down):
            x = functional.leaky_relu(convolution(functional.avg_pool2d(x, 2) if level else x), NEGATIVE_SLOPE)
            skips.append(x)
        for convolution, skip in zip(self.up, skips[-2::-1], strict=True):
            x = torch.cat([functional.interpolate(x, scale_factor=2.0), skip], 1)
            x = functional.leaky_relu(convolution(x), NEGATIVE_SLOPE)
        return self.last(x)


def filter_light(light: Tensor, normal: Tensor, position: Tensor, weight: Tensor, logits: Tensor,
                 dilation: int) -> Tensor:
    """Mean of the light of ``SIDE``² texels around each one, ``dilation`` texels apart.

    Parameters
    ----------
    light : Tensor, shape (B, C, h, w)
    normal, position : Tensor, shape (B, 3, h, w)
    weight : Tensor, shape (B, 1, h, w)
        Logarithm of how much each texel counts.
    logits : Tensor, shape (B, ``TAPS``, h, w)
        Added to the prior of each texel's neighbours.
    """
    channels = int(light.shape[1])
    around = neighbours(torch.cat([light, normal, position, weight - MIN_EXPONENT], 1), dilation)
    lights, normals, positions, weights = torch.split(around, [channels, 3, 3, 1], dim=1)
    cosine = (normals * normal.unsqueeze(2)).sum(1)
    offset = ((positions - position.unsqueeze(2)) * normal.unsqueeze(2)).sum(1)
    plane = offset / (PLANE_SIGMA * (-position[:, 2:]).clamp(min=MIN_DEPTH))
    exponent = logits - NORMAL_WEIGHT * (1 - cosine) - plane.square() + weights[:, 0] + MIN_EXPONENT
    kernel = exponent.clamp(2 * MIN_EXPONENT, MAX_EXPONENT).exp()
    return (lights * kernel.unsqueeze(1)).sum(2) / kernel.sum(1, keepdim=True)


def neighbours(x: Tensor, dilation: int) -> Tensor:
    """The texels around each one, shape (B, C, ``TAPS``, h, w); zeros beyond the image."""
    height, width = x.shape[2:]
    padded = functional.pad(x, (SIDE // 2 * dilation,) * 4)
    return torch.stack([padded[:, :, dilation * i:dilation * i + height, dilation * j:dilation * j + width]
                        for i in range(SIDE) for j in range(SIDE)], 2)


def _conv(inputs: int, outputs: int) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, padding=1)
