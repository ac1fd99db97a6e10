"""BCNN: a U-Net of bilateral convolutions, which do not mix texels across depth edges.

Xin et al. 2021, "Lightweight Bilateral Convolutional Neural Networks for Interactive Single-bounce Diffuse Indirect
Illumination". The paper leaves widths, pooling and the last activation open; this module documents the choices.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from app.network.contract import ModelContract, TensorSpec
from export.models.channel_normalization import denormalize_channels, normalize_channels
from export.models.network import EXTENT, MAX_POSITION, NEGATIVE_SLOPE, Network, Preset, sanitize

DEPTH_SIGMA = 1.0      # in the unit of EXTENT
MIN_TAP_WEIGHT = 1e-7  # reached at 4σ and 0 beyond: denormal numbers would slow every product
TAPS = 9               # of a 3×3 kernel, row by row
CHANNELS = ("direct.rgb", "normal.view.xyz", "position.view.xyz")
INPUTS = ("direct", "normal", "position")
PRESETS = {
    "bcnn-paper": Preset((64, 128, 256, 512), 1 / 2),
    "bcnn-32": Preset((32, 64, 128, 256), 1 / 2),
    "bcnn-16": Preset((16, 32, 64, 128), 1 / 4),
    "bcnn-8": Preset((8, 16, 32, 64), 1 / 4),
}


class Bcnn(Network):
    """Indirect light from the screen-space G-buffer and direct light.

    Three encoder levels, a bottleneck and three decoder levels with skips; two convolutions at full size and one at
    each other level, which gives 3.95 M weights with the paper's widths. Mean pooling, nearest-neighbour upsampling,
    final softplus. Each colour is normalized by its mean, so f(αx) = αf(x) holds for each colour without training.

    Attributes
    ----------
    bilateral : bool
        False selects plain convolutions, for ablations.
    reads : sequence of str
        Subset of ``INPUTS`` for the first convolution, for ablations; depth always guides the taps.
    """

    def __init__(self, name: str, bounces: str = "multi", bilateral: bool = True,
                 reads: Sequence[str] = INPUTS) -> None:
        super().__init__()
        preset = PRESETS[name]
        self.bilateral, self.reads = bilateral, tuple(reads)
        if not set(self.reads) <= set(INPUTS):
            raise ValueError(f"reads = {list(reads)}, expected some of: {', '.join(INPUTS)}")
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
            The contract's channels; radiance relative to the mean of the frame; h and w multiples of 8.

        Returns
        -------
        Tensor, shape (B, 3, h, w)
            Indirect radiance / albedo, at least 0; 0 in the sky.
        """
        x = sanitize(x, self.contract.inputs["x"])
        light, normal, position = torch.split(x, 3, dim=1)
        surface = (normal.abs().sum(1, keepdim=True) > 0).to(x.dtype)
        levels = pyramid(position[:, 2:], surface, len(self.down), self.bilateral)
        normalized, means = normalize_channels(light, surface)
        parts = {"direct": normalized, "normal": normal,
                 "position": (position / EXTENT).clamp(-MAX_POSITION, MAX_POSITION)}
        x = torch.cat([parts[name] for name in self.reads], 1) * surface
        skips = []
        for block, level in zip(self.down, levels, strict=False):
            x = block(x, level.taps)
            skips.append(x)
            x = functional.avg_pool2d(x * level.surface, 2) * level.pool_scale
        x = self.bottom(x, levels[-1].taps)
        for block, level, skip in zip(self.up, levels[-2::-1], skips[::-1], strict=True):
            x = block(torch.cat([functional.interpolate(x, scale_factor=2.0), skip], 1), level.taps)
        light_out = functional.softplus(self.last(x, levels[0].taps))
        return denormalize_channels(light_out, means).to(light.dtype) * surface


@dataclass(frozen=True)
class Level:
    """Geometry of one resolution, shared by its convolutions.

    Attributes
    ----------
    taps : Tensor, shape (B, 9, h, w)
        Weight of each tap, 0 to 1.
    surface : Tensor, shape (B, 1, h, w)
        1 on surfaces, 0 in the sky.
    pool_scale : Tensor, shape (B, 1, h / 2, w / 2)
        Turns a mean over 2×2 texels into the mean over those that show a surface.
    """

    taps: Tensor
    surface: Tensor
    pool_scale: Tensor


def pyramid(depth: Tensor, surface: Tensor, halvings: int, bilateral: bool = True) -> list[Level]:
    """All levels from full size down; ``depth`` and ``surface`` are [B, 1, h, w], and the sky is left out of pooling.

    Computed in single precision, since squared depth differences exceed the range of half precision.
    """
    dtype, levels = depth.dtype, []
    depth, surface = depth.float(), surface.float()
    for _ in range(halvings + 1):
        share = functional.avg_pool2d(surface, 2, ceil_mode=True)
        pool_scale = 1 / share.clamp(min=0.25)
        taps = bilateral_taps(depth, surface) if bilateral else surface.expand(-1, TAPS, -1, -1)
        levels.append(Level(taps.to(dtype), surface.to(dtype), pool_scale.to(dtype)))
        depth = functional.avg_pool2d(depth * surface, 2, ceil_mode=True) * pool_scale
        surface = share.sign()
    return levels


def bilateral_taps(depth: Tensor, surface: Tensor) -> Tensor:
    """exp(−(z_i − z_j)² / σ²) for each texel of the 3×3 neighbourhood, 0 where either texel shows the sky.

    Returns
    -------
    Tensor, shape (B, 9, h, w)
        Symmetric: two neighbours have the same weight for each other.
    """
    both = gather_neighbours(torch.cat([depth, surface], 1))
    weight = functional.relu(torch.exp(-((both[:, 0] - depth) / DEPTH_SIGMA).square()) - MIN_TAP_WEIGHT)
    return weight * both[:, 1] * surface


class Bilateral(nn.Module):
    """A 3×3 convolution whose taps are multiplied by the tap weights of their level.

    Two equivalent forms exist, and the one with the smaller intermediate is used: gather the neighbours' channels,
    weight them and convolve 1×1; or convolve 1×1 for each of the nine neighbours, weight and scatter.
    docs/training.md compares their speed.
    """

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.empty(outputs, inputs, 3, 3))
        self.bias = nn.Parameter(torch.zeros(outputs))
        nn.init.xavier_uniform_(self.weight)

    def forward(self, x: Tensor, taps: Tensor) -> Tensor:
        """Convolve ``x`` [B, C, h, w] with the tap weights ``taps`` [B, 9, h, w]."""
        outputs, inputs = map(int, self.weight.shape[:2])
        taps = taps.to(x.dtype).unsqueeze(1)
        if inputs < 2 * outputs:
            weight = self.weight.reshape(outputs, inputs * TAPS, 1, 1)
            return functional.conv2d((gather_neighbours(x) * taps).flatten(1, 2), weight, self.bias)
        # The weights are symmetric, so the sender's can stand for the receiver's.
        weight = self.weight.flip(2, 3).permute(0, 2, 3, 1).reshape(outputs * TAPS, inputs, 1, 1)
        sent = torch.unflatten(functional.conv2d(x, weight), 1, (outputs, TAPS)) * taps
        return scatter_neighbours(sent) + self.bias.reshape(-1, 1, 1)


class Block(nn.Module):
    """Bilateral convolutions from width to width, each followed by LeakyReLU."""

    def __init__(self, *widths: int) -> None:
        super().__init__()
        self.convolutions = nn.ModuleList(map(Bilateral, widths, widths[1:]))

    def forward(self, x: Tensor, taps: Tensor) -> Tensor:
        for convolution in self.convolutions:
            x = functional.leaky_relu(convolution(x, taps), NEGATIVE_SLOPE)
        return x


def gather_neighbours(x: Tensor) -> Tensor:
    """The 3×3 neighbourhood of each texel, shape (B, C, 9, h, w), 0 beyond the image."""
    channels, size = int(x.shape[1]), x.shape[2:]
    if torch.onnx.is_in_onnx_export():
        taps = functional.conv2d(x, _one_hot(x).repeat(channels, 1, 1, 1), padding=1, groups=channels)
        return torch.unflatten(taps, 1, (channels, TAPS))
    return functional.unfold(x, 3, padding=1).reshape(-1, channels, TAPS, *size)


def scatter_neighbours(x: Tensor) -> Tensor:
    """The sum [B, C, h, w] that each texel receives when all texels send ``x`` [B, C, 9, h, w] to their neighbours."""
    channels, size = int(x.shape[1]), x.shape[3:]
    if torch.onnx.is_in_onnx_export():
        taps = _one_hot(x).flip(0).transpose(0, 1).repeat(channels, 1, 1, 1)
        return functional.conv2d(x.flatten(1, 2), taps, padding=1, groups=channels)
    return functional.fold(x.flatten(1, 2).flatten(2), size, 3, padding=1)


def _one_hot(like: Tensor) -> Tensor:
    """Kernels [9, 1, 3, 3] that each select one neighbour: faster than im2col in ONNX, and supported everywhere."""
    return torch.eye(TAPS, dtype=like.dtype, device=like.device).reshape(TAPS, 1, 3, 3)
