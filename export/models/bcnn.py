"""BCNN: a U-Net whose every convolution looks across no depth edge.

Xin et al. 2021, "Lightweight Bilateral Convolutional Neural Networks for Interactive Single-bounce Diffuse Indirect
Illumination". Where the text is silent (widths, which pooling, the last activation) the choice is named here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from app.network.contract import ModelContract, TensorSpec
from export.models.channel_normalization import in_own_means, times_means
from export.models.finite import finite
from export.models.network import Network

SIGMA = 1.0       # of the depth difference, in units of a scene whose longest edge is EXTENT
EXTENT = 40.0
CUT = 1e-7        # of a tap's factor: nothing at 4σ and beyond, and no denormal numbers, which slow every product
SLOPE = 0.1       # of LeakyReLU below 0
TAPS = 9          # of a 3×3 kernel, row by row
FARTHEST = 2.0    # extents; so that no input can overflow half precision
CHANNELS = ("direct.rgb", "normal.view.xyz", "position.view.xyz")
READS = ("direct", "normal", "position")


@dataclass(frozen=True)
class Preset:
    """Channels of the three encoder levels and of the bottleneck, and the grid relative to the image."""

    widths: tuple[int, int, int, int]
    scale: float


PRESETS = {
    "bcnn-paper": Preset((64, 128, 256, 512), 1 / 2),
    "bcnn-32": Preset((32, 64, 128, 256), 1 / 2),
    "bcnn-16": Preset((16, 32, 64, 128), 1 / 4),
    "bcnn-8": Preset((8, 16, 32, 64), 1 / 4),
}


class Bcnn(Network):
    """Indirect light from what the screen shows.

    Three encoder levels, a bottleneck and three decoder levels with skips; two convolutions at full size, one at each
    other level, which with the paper's widths makes 3.95 M weights. Mean pooling, nearest-neighbour upsampling,
    softplus at the end. Light goes in and out in each colour's mean, so colours and f(αx) = αf(x) come by themselves.

    Attributes
    ----------
    contract : ModelContract
    bilateral : bool
        False makes plain convolutions, for ablations.
    reads : sequence of str
        Which of ``READS`` the first convolution gets, for ablations; depth guides the taps all the same.
    """

    def __init__(self, name: str, bounces: str = "multi", bilateral: bool = True, reads: Sequence[str] = READS) -> None:
        super().__init__()
        preset = PRESETS[name]
        self.bilateral, self.reads = bilateral, tuple(reads)
        if not set(self.reads) <= set(READS):
            raise ValueError(f"reads {list(reads)}, known are {', '.join(READS)}")
        self.contract = ModelContract(
            name=name if bounces == "multi" else f"{name}-{bounces}",
            paper="Xin et al. 2021, Lightweight Bilateral Convolutional Neural Networks",
            inputs={"x": TensorSpec(CHANNELS)}, outputs={"y": TensorSpec(("indirect.rgb",))}, scale=preset.scale,
            multiple_of=8, exposure="mean-radiance", bounces=bounces, scene_extent=EXTENT, licence="MIT")
        a, b, c, d = preset.widths
        self.down = nn.ModuleList([Block(3 * len(self.reads), a, a), Block(a, b), Block(b, c)])
        self.bottom = Block(c, d)
        self.up = nn.ModuleList([Block(d + c, c), Block(c + b, b), Block(b + a, a, a)])
        self.last = Bilateral(a, 3)

    def forward(self, x: Tensor) -> Tensor:
        """Infer one batch of frames.

        Parameters
        ----------
        x : Tensor, shape (B, 9, h, w)
            The contract's channels, radiance in means of the frame, h and w multiples of 8.

        Returns
        -------
        Tensor, shape (B, 3, h, w)
            Indirect radiance / albedo, at least 0; 0 in the sky.
        """
        x = finite(x, self.contract.inputs["x"])
        light, normal, position = torch.split(x, 3, dim=1)
        surface = (normal.abs().sum(1, keepdim=True) > 0).to(x.dtype)
        levels = pyramid(position[:, 2:], surface, len(self.down), self.bilateral)
        relative, means = in_own_means(light, surface)
        parts = {"direct": relative, "normal": normal,
                 "position": (position / EXTENT).clamp(-FARTHEST, FARTHEST)}
        x = torch.cat([parts[name] for name in self.reads], 1) * surface
        skips = []
        for block, level in zip(self.down, levels, strict=False):
            x = block(x, level.taps)
            skips.append(x)
            x = functional.avg_pool2d(x * level.surface, 2) * level.spread
        x = self.bottom(x, levels[-1].taps)
        for block, level, skip in zip(self.up, levels[-2::-1], skips[::-1], strict=True):
            x = block(torch.cat([functional.interpolate(x, scale_factor=2.0), skip], 1), level.taps)
        return times_means(functional.softplus(self.last(x, levels[0].taps)), means).to(light.dtype) * surface


@dataclass(frozen=True)
class Level:
    """Geometry of one resolution, shared by its convolutions.

    Attributes
    ----------
    taps : Tensor, shape (B, 9, h, w)
        Factor of each tap, 0 to 1.
    surface : Tensor, shape (B, 1, h, w)
        1 where there is one, 0 in the sky.
    spread : Tensor, shape (B, 1, h / 2, w / 2)
        Turns a mean over 2×2 texels into one over those that show a surface.
    """

    taps: Tensor
    surface: Tensor
    spread: Tensor


def pyramid(depth: Tensor, surface: Tensor, halvings: int, bilateral: bool = True) -> list[Level]:
    """The levels from full size down; depth [B, 1, h, w] is pooled along, over surfaces (``surface`` is 1) alone.

    In single precision inside, as squares of depth differences leave the range of half.
    """
    kind, levels = depth.dtype, []
    depth, surface = depth.float(), surface.float()
    for _ in range(halvings + 1):
        share = functional.avg_pool2d(surface, 2, ceil_mode=True)
        spread = 1 / share.clamp(min=0.25)
        taps = bilateral_taps(depth, surface) if bilateral else surface.expand(-1, TAPS, -1, -1)
        levels.append(Level(taps.to(kind), surface.to(kind), spread.to(kind)))
        depth = functional.avg_pool2d(depth * surface, 2, ceil_mode=True) * spread
        surface = share.sign()
    return levels


def bilateral_taps(depth: Tensor, surface: Tensor) -> Tensor:
    """exp(−(z_i − z_j)² / σ²) towards each texel of the 3×3 neighbourhood, 0 where either shows the sky.

    Returns
    -------
    Tensor, shape (B, 9, h, w)
        Symmetric: a texel's factor for its neighbour is the neighbour's for it.
    """
    both = neighbours(torch.cat([depth, surface], 1))
    near = functional.relu(torch.exp(-((both[:, 0] - depth) / SIGMA).square()) - CUT)
    return near * both[:, 1] * surface


class Bilateral(nn.Module):
    """A 3×3 convolution whose taps are multiplied by the factors of their level.

    Of two ways to write it the one with the smaller intermediate is taken: gather the neighbours' channels, weigh
    them, then convolve 1×1; or convolve 1×1 towards each of the nine neighbours, weigh, then let them scatter. Both
    are the same sum; figures are in docs/network.md.
    """

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.empty(outputs, inputs, 3, 3))
        self.bias = nn.Parameter(torch.zeros(outputs))
        nn.init.xavier_uniform_(self.weight)

    def forward(self, x: Tensor, taps: Tensor) -> Tensor:
        """Convolve x [B, C, h, w] by the level's ``taps`` [B, 9, h, w]."""
        outputs, inputs = map(int, self.weight.shape[:2])
        taps = taps.to(x.dtype).unsqueeze(1)
        if inputs < 2 * outputs:
            weight = self.weight.reshape(outputs, inputs * TAPS, 1, 1)
            return functional.conv2d((neighbours(x) * taps).flatten(1, 2), weight, self.bias)
        # The factors are symmetric, so the sender's stand for the receiver's.
        weight = self.weight.flip(2, 3).permute(0, 2, 3, 1).reshape(outputs * TAPS, inputs, 1, 1)
        sent = torch.unflatten(functional.conv2d(x, weight), 1, (outputs, TAPS)) * taps
        return scattered(sent) + self.bias.reshape(-1, 1, 1)


class Block(nn.Module):
    """Bilateral convolutions from width to width, each with its LeakyReLU."""

    def __init__(self, *widths: int) -> None:
        super().__init__()
        self.convolutions = nn.ModuleList(map(Bilateral, widths, widths[1:]))

    def forward(self, x: Tensor, taps: Tensor) -> Tensor:
        for convolution in self.convolutions:
            x = functional.leaky_relu(convolution(x, taps), SLOPE)
        return x


def neighbours(x: Tensor) -> Tensor:
    """The 3×3 neighbourhood of each texel, shape (B, C, 9, h, w), 0 beyond the image."""
    channels, size = int(x.shape[1]), x.shape[2:]
    if torch.onnx.is_in_onnx_export():
        taps = functional.conv2d(x, _one_hot(x).repeat(channels, 1, 1, 1), padding=1, groups=channels)
        return torch.unflatten(taps, 1, (channels, TAPS))
    return functional.unfold(x, 3, padding=1).reshape(-1, channels, TAPS, *size)


def scattered(x: Tensor) -> Tensor:
    """What each texel receives, shape (B, C, h, w), when all send ``x`` [B, C, 9, h, w] to their neighbourhood."""
    channels, size = int(x.shape[1]), x.shape[3:]
    if torch.onnx.is_in_onnx_export():
        taps = _one_hot(x).flip(0).transpose(0, 1).repeat(channels, 1, 1, 1)
        return functional.conv2d(x.flatten(1, 2), taps, padding=1, groups=channels)
    return functional.fold(x.flatten(1, 2).flatten(2), size, 3, padding=1)


def _one_hot(like: Tensor) -> Tensor:
    """Kernels, shape (9, 1, 3, 3), of which each picks one neighbour: in ONNX faster than im2col, and everywhere."""
    return torch.eye(TAPS, dtype=like.dtype, device=like.device).reshape(TAPS, 1, 3, 3)
