"""Final gathering cleaned by predicted kernels: a few rays a texel in, their light without noise out.

A U-Net writes the logits of four filters, which an edge-avoiding à-trous scheme applies one after the other (Dammertz
et al. 2010, "Edge-Avoiding À-Trous Wavelet Transform for fast Global Illumination Filtering"; kernel prediction: Bako
et al. 2017, "Kernel-Predicting Convolutional Networks for Denoising Monte Carlo Renderings").
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from app.network.contract import ModelContract, TensorSpec
from export.models.network import EXTENT, NEGATIVE_SLOPE, Network, sanitize

CHANNELS = ("gathered.rgb", "gathered.count", "gathered.distance", "interpolated.rgb", "normal.view.xyz",
            "position.view.xyz")
WIDTHS = (16, 32, 32)    # channels at half, quarter and eighth size
AROUND = (-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, 1), (1, -1), (-1, 1)  # taps beside the middle one
TAPS = 1 + len(AROUND)
FEATURES = 12  # light and the number of its rays, the distance of their ends, interpolated light, normal, depth
CORNERS = 4  # texels of 2×2
STEPS = 8, 4, 2, 1  # texels between the taps of each kernel; no longer than the smallest grid
OUTPUTS = len(STEPS) * TAPS + 1  # logits of all taps, and of the share of interpolated light
# A prior that the logits are added to: minus
NORMAL_WEIGHT = 16.0   # times 1 - the cosine between the normals,
PLANE_SIGMA = 0.02     # and the squared distance from the texel's plane, in units of this share of the depth,
MAX_LOGIT = 12.0
MIN_EXPONENT, MAX_EXPONENT = -40.0, 30.0  # of the middle tap, so that kernels have a finite sum above 0
MIN_COUNT = 1e-3       # of rays, so that its logarithm is finite
MIN_WEIGHT = 1e-30     # so that nothing divides by 0
MAX_COUNT = 32.0       # of rays, that features tell apart; training has no more
MIN_DEPTH = 1e-3       # in the unit of EXTENT
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

    The output is a weighted mean of its inputs' light: it creates no energy, and is linear in light for given weights.
    The weights depend on light only relative to the mean of the frame. Texels without rays get the light of those
    around.

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
        return self._light(self.body(fold(features), fold(surface)), texels) * surface

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


@dataclass(frozen=True)
class Surfaces:
    """What the prior compares, each of shape (B, C, h, w).

    Attributes
    ----------
    normal, position : Tensor
        Unit normals, or 0 in the sky, and positions.
    axis : Tensor
        Normals in units of the tolerated distance from a texel's plane.
    plane : Tensor
        Where the texel's own plane is, in that unit.
    """

    normal: Tensor
    position: Tensor
    axis: Tensor
    plane: Tensor

    def priors(self, step: int) -> Iterator[Tensor]:
        """What is added to the logits of the texels ``step`` away, in the order of ``AROUND``."""
        for cosine, position in zip(self._cosines(step), _around(self.position, step, AROUND), strict=True):
            yield cosine - (_dot(self.axis, position) - self.plane).square()

    def _cosines(self, step: int) -> Iterator[Tensor]:
        """Cosines between normals minus 1, times ``NORMAL_WEIGHT``; for opposite sides the same ones, moved."""
        sides = AROUND[::2]
        for (right, down), normal in zip(sides, _around(self.normal, step, sides), strict=True):
            cosine = _dot(self.normal, normal, NORMAL_WEIGHT, -NORMAL_WEIGHT)
            yield cosine
            yield _shifted(cosine, -step * right, -step * down, value=-NORMAL_WEIGHT)


def surfaces_of(normal: Tensor, position: Tensor) -> Surfaces:
    """For unit normals, or 0 in the sky, and positions of shape (B, 3, h, w)."""
    axis = normal / (PLANE_SIGMA * (-position[:, 2:]).clamp(min=MIN_DEPTH))
    return Surfaces(normal, position, axis, _dot(axis, position))


def filter_light(lit: Tensor, surfaces: Surfaces, middle: Tensor, around: Sequence[Tensor], step: int) -> Tensor:
    """Weighted mean of ``lit`` of the texels ``step`` away from each one.

    Tap by tap, since tensors of all taps would not stay in the CPU's cache.

    Parameters
    ----------
    lit : Tensor, shape (B, 4, h, w)
        Light times how much each texel counts, and how much it counts, relative to others.
    middle : Tensor, shape (B, 1, h, w)
        Logit of each texel itself.
    around : sequence of Tensor, shape (B, 1, h, w)
        Logits of those ``AROUND``, which are added to the prior.
    """
    total = middle.clamp(MIN_EXPONENT, MAX_EXPONENT).exp()
    sums = lit * total
    for logit, prior, light in zip(around, surfaces.priors(step), _around(lit, step, AROUND), strict=True):
        kernel = (logit + prior).exp()
        total = total + kernel
        sums = sums + light * kernel
    return sums / total


def _dot(a: Tensor, b: Tensor, factor: float = 1.0, offset: float = 0.0) -> Tensor:
    """Scalar products of vectors of shape (B, 3, h, w), times a factor, plus an offset."""
    # In onnxruntime fastest as a convolution, in three dimensions, since it rearranges the channels for one in two.
    weight, bias = a.new_full((1, 3, 1, 1, 1), factor), a.new_full((1,), offset)
    return functional.conv3d((a * b).unsqueeze(2), weight, bias).squeeze(2)


def _around(x: Tensor, step: int, sides: Sequence[tuple[int, int]]) -> Iterator[Tensor]:
    """The texels ``step`` to these sides of each one; 0 beyond the image."""
    padded = functional.pad(x, (step,) * 4)
    return (_shifted(padded, step * right, step * down, -step) for right, down in sides)


def _shifted(x: Tensor, right: int, down: int, margin: int = 0, value: float = 0.0) -> Tensor:
    """The texels to the right and below of each one, without a margin of ``x``; ``value`` beyond ``x``."""
    return functional.pad(x, (margin - right, margin + right, margin - down, margin + down), value=value)


def fold(x: Tensor) -> Tensor:
    """``pixel_unshuffle`` by 2: (B, C, 2 h, 2 w) to (B, 4 C, h, w); in onnxruntime faster as a convolution."""
    channels = int(x.shape[1])
    return functional.conv2d(x, _corners(channels, x), stride=2, groups=channels)


def _corners(channels: int, like: Tensor) -> Tensor:
    """Kernels [4 · channels, 1, 2, 2] that each select one texel of 2×2."""
    return torch.eye(CORNERS, dtype=like.dtype, device=like.device).reshape(CORNERS, 1, 2, 2).repeat(channels, 1, 1, 1)


def conv(inputs: int, outputs: int) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, padding=1)
