"""GFA: a U-Net shades one colour at a time; a second U-Net modulates it and computes its attention from geometry.

Gai, Wang and Li 2025, "Geometry-Aware Global Feature Aggregation for Real-Time Indirect Illumination". The paper leaves
widths, pooling, activations and the size of keys open; this module documents the choices.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from app.network.contract import ModelContract, TensorSpec
from export.models.attention import MAX_KEYS, Attention
from export.models.channel_normalization import denormalize_channels, normalize_channels
from export.models.network import EXTENT, MAX_LOGIT, MAX_POSITION, NEGATIVE_SLOPE, Network, Preset, sanitize

GEOMETRY = ("normal.view.xyz", "position.view.xyz", "depth")
SHADING = ("direct.rgb", "albedo.rgb")
GEOMETRY_CHANNELS, SHADING_CHANNELS = 7, 2  # light and albedo of one colour
COLORS = 3
EQUAL_COST = 7 / 4  # width factor at which one run for three colours costs as much as three runs for one
HALVINGS = 3
LEVELS, BLOCKS = HALVINGS + 1, 2 * HALVINGS + 1
PRESETS = {  # the last width is also that of the bottleneck
    "gfa-paper": Preset((64, 128, 256), 1 / 2),
    "gfa-mini": Preset((48, 96, 200), 1 / 2),
    "gfa-16": Preset((16, 32, 64), 1 / 4),
    "gfa-8": Preset((8, 16, 32), 1 / 4),
}


@dataclass(frozen=True)
class Guidance:
    """Everything that depends on geometry alone, the same for all colours and any light.

    Attributes
    ----------
    scale, shift : sequence of Tensor, shape (B, C, h, w)
        γ − 1 and β of each block.
    surfaces : sequence of Tensor, shape (B, 1, h, w)
        Surface mask of each level, from full size down: 1 on surfaces, 0 in the sky.
    pool_scales : sequence of Tensor, shape (B, 1, h / 2, w / 2)
        Turn a level's means over 2×2 texels into means over those that show a surface.
    weights : sequence of Tensor, shape (B, heads, texels, keys)
        Attention weights of the bottleneck, normalized over keys; empty without attention.
    """

    scale: Sequence[Tensor]
    shift: Sequence[Tensor]
    surfaces: Sequence[Tensor]
    pool_scales: Sequence[Tensor]
    weights: Sequence[Tensor]

    @property
    def tensors(self) -> list[Tensor]:
        """All tensors as one list."""
        return [*self.scale, *self.shift, *self.surfaces, *self.pool_scales, *self.weights]

    @staticmethod
    def from_tensors(tensors: Sequence[Tensor]) -> Guidance:
        """The inverse of ``tensors``."""
        ends = (0, BLOCKS, 2 * BLOCKS, 2 * BLOCKS + LEVELS, 2 * BLOCKS + 2 * LEVELS, len(tensors))
        return Guidance(*(tensors[begin:end] for begin, end in pairwise(ends)))


class Gfa(Network):
    """Indirect light from the screen-space G-buffer, direct light and albedo, with attention at the bottleneck.

    Attributes
    ----------
    heads : int
        Attention heads; 0 disables attention, for ablations.
    layers : int
        Convolutions that replace attention, for ablations.
    per_color : bool
        False shades the three colours in one run of a network of the same cost, for ablations.
    dropout : float
        Share of the decoder's channels that is dropped during training.
    max_keys : int
        Limit of the attention's keys; see ``Attention``.
    """

    def __init__(self, name: str, heads: int = 8, dropout: float = 0.1, max_keys: int = MAX_KEYS, layers: int = 0,
                 per_color: bool = True) -> None:
        super().__init__()
        preset = PRESETS[name]
        self.runs = COLORS if per_color else 1
        colors_per_run = COLORS // self.runs
        a, b, c = (w if per_color else int(w * EQUAL_COST) for w in preset.widths)
        self.contract = ModelContract(
            name=name, paper="Gai et al. 2025, Geometry-Aware Global Feature Aggregation",
            inputs={"geometry": TensorSpec(GEOMETRY), "shading": TensorSpec(SHADING)},
            outputs={"y": TensorSpec(("indirect.rgb",))}, scale=preset.scale, multiple_of=2**HALVINGS,
            exposure="mean-radiance", bounces="multi", scene_extent=EXTENT, static_input="geometry", licence="MIT")
        self.geometry = UNet(GEOMETRY_CHANNELS, preset.widths)
        self.shading = UNet(SHADING_CHANNELS * colors_per_run, (a, b, c), dropout)
        self.modulations = nn.ModuleList(nn.Conv2d(g + GEOMETRY_CHANNELS, 2 * w, 3, padding=1) for g, w in
                                         zip(self.geometry.widths, self.shading.widths, strict=True))
        self.attention = Attention(preset.widths[-1], c, heads, max_keys) if heads else None
        self.more = nn.ModuleList(nn.Conv2d(c, c, 3, padding=1) for _ in range(layers))
        self.last = nn.Conv2d(a, colors_per_run, 3, padding=1)
        for layer in self.modules():
            if isinstance(layer, nn.Conv2d):
                nn.init.xavier_uniform_(layer.weight)
                if layer.bias is not None:
                    nn.init.zeros_(layer.bias)

    def forward(self, geometry: Tensor, shading: Tensor) -> Tensor:
        """Infer one batch of frames.

        Parameters
        ----------
        geometry : Tensor, shape (B, 7, h, w)
        shading : Tensor, shape (B, 6, h, w)
            The contract's channels; radiance relative to the mean of the frame; h and w multiples of 8.

        Returns
        -------
        Tensor, shape (B, 3, h, w)
            Indirect radiance / albedo, at least 0; 0 in the sky.
        """
        return self.shade(shading, self.guide(geometry))

    def guide(self, geometry: Tensor) -> Guidance:
        """Everything that depends on ``geometry`` [B, 7, h, w] alone."""
        geometry = sanitize(geometry, self.contract.inputs["geometry"])
        normal, position = torch.split(geometry, [3, GEOMETRY_CHANNELS - 3], dim=1)
        surface = (normal.abs().sum(1, keepdim=True) > 0).to(geometry.dtype)
        position = (position / EXTENT).clamp(-MAX_POSITION, MAX_POSITION)
        raw, surfaces, pool_scales = pyramid(torch.cat([normal, position], 1), surface)
        masks = surfaces + surfaces[-2::-1]  # of each block
        encoded = self.geometry(raw[0], pool_scales,
                                lambda block, x: functional.leaky_relu(x, NEGATIVE_SLOPE) * masks[block])
        both = [torch.cat(pair, 1) for pair in zip(encoded, raw + raw[-2::-1], strict=True)]
        scale, shift = zip(*(m(g).chunk(2, dim=1) for m, g in zip(self.modulations, both, strict=True)), strict=True)
        weights = [self.attention.weights(encoded[HALVINGS], surfaces[-1])] if self.attention else []
        return Guidance(scale, shift, surfaces, pool_scales, weights)

    def shade(self, shading: Tensor, guidance: Guidance) -> Tensor:
        """Indirect light [B, 3, h, w] from direct light and albedo, ``shading`` [B, 6, h, w]."""
        light, albedo = sanitize(shading, self.contract.inputs["shading"]).chunk(2, dim=1)
        normalized, means = normalize_channels(light, guidance.surfaces[0])
        surfaces = [*guidance.surfaces, *guidance.surfaces[-2::-1]]  # of each block

        def modulate(block: int, x: Tensor) -> Tensor:
            x = torch.unflatten(x, 0, (-1, self.runs))
            x = x * (1 + guidance.scale[block].unsqueeze(1)) + guidance.shift[block].unsqueeze(1)
            x = functional.leaky_relu(x, NEGATIVE_SLOPE) * surfaces[block].unsqueeze(1)
            if block == HALVINGS and self.attention is not None:
                x = x + self.attention(x, guidance.weights[0], surfaces[block])
            x = x.flatten(0, 1)
            for layer in self.more if block == HALVINGS else ():
                x = functional.leaky_relu(layer(x), NEGATIVE_SLOPE) * surfaces[block].repeat_interleave(self.runs, 0)
            return x

        x = torch.stack([normalized, albedo], 2) * surfaces[0].unsqueeze(1)  # (B, colours, 2, h, w)
        x = torch.unflatten(x.flatten(1, 2), 1, (self.runs, -1)).flatten(0, 1)
        pool_scales = [scale.repeat_interleave(self.runs, 0) for scale in guidance.pool_scales]
        logits = self.last(self.shading(x, pool_scales, modulate)[-1]).float().clamp(max=MAX_LOGIT)
        indirect = torch.unflatten(logits.exp(), 0, (-1, self.runs)).flatten(1, 2)
        return denormalize_channels(indirect, means).to(light.dtype) * surfaces[0]

    def precompute(self, geometry: Tensor) -> list[Tensor]:
        return self.guide(geometry).tensors

    def finish(self, cached: Sequence[Tensor], shading: Tensor) -> Tensor:
        return self.shade(shading, Guidance.from_tensors(cached))


class UNet(nn.Module):
    """Seven blocks of two convolutions: three levels down, the bottleneck, three levels up with skips.

    Attributes
    ----------
    widths : sequence of int
        Channels of each block.
    """

    def __init__(self, inputs: int, widths: Sequence[int], dropout: float = 0.0) -> None:
        super().__init__()
        a, b, c = widths
        self.widths = (a, b, c, c, c, b, a)
        self.blocks = nn.ModuleList(map(_block, (inputs, a, b, c, c + c, c + b, b + a), self.widths))
        self.dropout = nn.Dropout2d(dropout)

    def forward(self, x: Tensor, pool_scales: Sequence[Tensor],
                activate: Callable[[int, Tensor], Tensor]) -> list[Tensor]:
        """The output of each block after ``activate(number, output)``; ``pool_scales`` as in ``Guidance``."""
        features: list[Tensor] = []
        for number, convolve in enumerate(self.blocks):
            if number > HALVINGS:
                skip = features[2 * HALVINGS - number]
                x = torch.cat([functional.interpolate(x, scale_factor=2.0), skip], 1)
            x = activate(number, convolve(x))
            if number > HALVINGS:
                x = self.dropout(x)
            features.append(x)
            if number < HALVINGS:
                x = functional.avg_pool2d(x, 2) * pool_scales[number]
        return features


def pyramid(raw: Tensor, surface: Tensor) -> tuple[list[Tensor], list[Tensor], list[Tensor]]:
    """Means of ``raw`` over surfaces, surface masks and pooling scales, from full size down; see ``Guidance``."""
    raws: list[Tensor] = []
    surfaces: list[Tensor] = []
    pool_scales: list[Tensor] = []
    for _ in range(LEVELS):
        raw = raw * surface
        share = functional.avg_pool2d(surface, 2, ceil_mode=True)
        raws.append(raw)
        surfaces.append(surface)
        pool_scales.append(1 / share.clamp(min=0.25))
        raw, surface = functional.avg_pool2d(raw, 2, ceil_mode=True) * pool_scales[-1], share.sign()
    return raws, surfaces, pool_scales


def _block(inputs: int, outputs: int) -> nn.Sequential:
    """Two convolutions; the caller activates the second."""
    return nn.Sequential(nn.Conv2d(inputs, outputs, 3, padding=1), nn.LeakyReLU(NEGATIVE_SLOPE),
                         nn.Conv2d(outputs, outputs, 3, padding=1))
