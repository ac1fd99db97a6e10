"""GFA: a U-Net shades one colour at a time; another, of the geometry, tells it how, and where to look.

Gai, Wang and Li 2025, "Geometry-Aware Global Feature Aggregation for Real-Time Indirect Illumination". Where the text
is silent (widths, pooling, activations, the size of keys) the choice is named here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from app.network.contract import ModelContract, TensorSpec
from export.models.channel_normalization import in_own_means, times_means
from export.models.finite import finite
from export.models.network import Network

EXTENT = 40.0
SLOPE = 0.1           # of LeakyReLU below 0
FARTHEST = 2.0        # extents; so that no input can overflow half precision
MAX_LOGIT = 11.0  # 6·10⁴ means
HIDDEN = -1e4         # logit of a key in the sky: no weight
MAX_KEYS = 1024      # of the attention, about; beyond, k×k of them are pooled to one
GEOMETRY = ("normal.view.xyz", "position.view.xyz", "depth")
SHADING = ("direct.rgb", "albedo.rgb")
RAW, SHADED = 7, 2    # channels of geometry, and of what one colour is shaded from
COLORS = 3
EQUAL_COST = 7 / 4    # times the width, one network for three colours costs what three runs of it cost
HALVINGS = 3
LEVELS, BLOCKS = HALVINGS + 1, 2 * HALVINGS + 1


@dataclass(frozen=True)
class Preset:
    """Channels of the three levels, the last also of the bottleneck, and the grid relative to the image."""

    widths: tuple[int, int, int]
    scale: float


PRESETS = {
    "gfa-paper": Preset((64, 128, 256), 1 / 2),
    "gfa-mini": Preset((48, 96, 200), 1 / 2),
    "gfa-16": Preset((16, 32, 64), 1 / 4),
    "gfa-8": Preset((8, 16, 32), 1 / 4),
}


@dataclass(frozen=True)
class Guidance:
    """What geometry decides, the same for each colour and all light.

    Attributes
    ----------
    scale, shift : sequence of Tensor, shape (B, C, h, w)
        γ − 1 and β of each block.
    surfaces : sequence of Tensor, shape (B, 1, h, w)
        1 where a level shows a surface, 0 in the sky; from full size down.
    spreads : sequence of Tensor, shape (B, 1, h / 2, w / 2)
        Turn a level's means over 2×2 texels into those over surfaces.
    weights : sequence of Tensor, shape (B, heads, texels, keys)
        What each texel of the bottleneck takes from the others, 1 in all; none without attention.
    """

    scale: Sequence[Tensor]
    shift: Sequence[Tensor]
    surfaces: Sequence[Tensor]
    spreads: Sequence[Tensor]
    weights: Sequence[Tensor]

    @property
    def tensors(self) -> list[Tensor]:
        """All of it in a row."""
        return [*self.scale, *self.shift, *self.surfaces, *self.spreads, *self.weights]

    @staticmethod
    def of(tensors: Sequence[Tensor]) -> Guidance:
        """What ``tensors`` gave."""
        ends = (0, BLOCKS, 2 * BLOCKS, 2 * BLOCKS + LEVELS, 2 * BLOCKS + 2 * LEVELS, len(tensors))
        return Guidance(*(tensors[begin:end] for begin, end in pairwise(ends)))


class Gfa(Network):
    """Indirect light from what the screen shows, gathered from all of it at the bottleneck.

    Attributes
    ----------
    contract : ModelContract
    heads : int
        Of the attention; 0 for none, for ablations.
    layers : int
        Convolutions in its place, for ablations.
    apart : bool
        False shades the three colours together, by a network of the same cost, for ablations.
    dropout : float
        Share of the decoder's channels that is dropped while training.
    most_keys : int
        Of the attention; see ``MAX_KEYS``.
    """

    def __init__(self, name: str, heads: int = 8, dropout: float = 0.1, most_keys: int = MAX_KEYS, layers: int = 0,
                 apart: bool = True) -> None:
        super().__init__()
        preset = PRESETS[name]
        self.runs = COLORS if apart else 1
        together = COLORS // self.runs  # colours of a run
        a, b, c = (w if apart else int(w * EQUAL_COST) for w in preset.widths)
        self.contract = ModelContract(
            name=name, paper="Gai et al. 2025, Geometry-Aware Global Feature Aggregation",
            inputs={"geometry": TensorSpec(GEOMETRY), "shading": TensorSpec(SHADING)},
            outputs={"y": TensorSpec(("indirect.rgb",))}, scale=preset.scale, multiple_of=2**HALVINGS,
            exposure="mean-radiance", bounces="multi", scene_extent=EXTENT, static_input="geometry", licence="MIT")
        self.geometry = UNet(RAW, preset.widths)
        self.shading = UNet(SHADED * together, (a, b, c), dropout)
        self.modulations = nn.ModuleList(nn.Conv2d(g + RAW, 2 * w, 3, padding=1) for g, w in
                                         zip(self.geometry.widths, self.shading.widths, strict=True))
        self.attention = Attention(preset.widths[-1], c, heads, most_keys) if heads else None
        self.more = nn.ModuleList(nn.Conv2d(c, c, 3, padding=1) for _ in range(layers))
        self.last = nn.Conv2d(a, together, 3, padding=1)
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
            The contract's channels, radiance in means of the frame, h and w multiples of 8.

        Returns
        -------
        Tensor, shape (B, 3, h, w)
            Indirect radiance / albedo, at least 0; 0 in the sky.
        """
        return self.shade(shading, self.guide(geometry))

    def guide(self, geometry: Tensor) -> Guidance:
        """What ``geometry`` [B, 7, h, w] decides."""
        geometry = finite(geometry, self.contract.inputs["geometry"])
        normal, places = torch.split(geometry, [3, RAW - 3], dim=1)
        surface = (normal.abs().sum(1, keepdim=True) > 0).to(geometry.dtype)
        raw, surfaces, spreads = pyramid(torch.cat([normal, (places / EXTENT).clamp(-FARTHEST, FARTHEST)], 1), surface)
        around = surfaces + surfaces[-2::-1]  # each block
        encoded = self.geometry(raw[0], spreads,
                                lambda block, x: functional.leaky_relu(x, SLOPE) * around[block])
        both = [torch.cat(pair, 1) for pair in zip(encoded, raw + raw[-2::-1], strict=True)]
        scale, shift = zip(*(m(g).chunk(2, dim=1) for m, g in zip(self.modulations, both, strict=True)), strict=True)
        weights = [self.attention.weights(encoded[HALVINGS], surfaces[-1])] if self.attention else []
        return Guidance(scale, shift, surfaces, spreads, weights)

    def shade(self, shading: Tensor, guidance: Guidance) -> Tensor:
        """Indirect light [B, 3, h, w] of direct light and albedo, ``shading`` [B, 6, h, w]."""
        light, albedo = finite(shading, self.contract.inputs["shading"]).chunk(2, dim=1)
        relative, means = in_own_means(light, guidance.surfaces[0])
        surfaces = [*guidance.surfaces, *guidance.surfaces[-2::-1]]  # around each block

        def guided(block: int, x: Tensor) -> Tensor:
            x = torch.unflatten(x, 0, (-1, self.runs))
            x = x * (1 + guidance.scale[block].unsqueeze(1)) + guidance.shift[block].unsqueeze(1)
            x = functional.leaky_relu(x, SLOPE) * surfaces[block].unsqueeze(1)
            if block == HALVINGS and self.attention is not None:
                x = x + self.attention(x, guidance.weights[0], surfaces[block])
            x = x.flatten(0, 1)
            for layer in self.more if block == HALVINGS else ():
                x = functional.leaky_relu(layer(x), SLOPE) * surfaces[block].repeat_interleave(self.runs, 0)
            return x

        x = torch.stack([relative, albedo], 2) * surfaces[0].unsqueeze(1)  # (B, colours, 2, h, w)
        x = torch.unflatten(x.flatten(1, 2), 1, (self.runs, -1)).flatten(0, 1)
        spreads = [spread.repeat_interleave(self.runs, 0) for spread in guidance.spreads]
        logits = self.last(self.shading(x, spreads, guided)[-1]).float().clamp(max=MAX_LOGIT)
        made = torch.unflatten(logits.exp(), 0, (-1, self.runs)).flatten(1, 2)
        return times_means(made, means).to(light.dtype) * surfaces[0]

    def precompute(self, geometry: Tensor) -> list[Tensor]:
        return self.guide(geometry).tensors

    def finish(self, cached: Sequence[Tensor], shading: Tensor) -> Tensor:
        return self.shade(shading, Guidance.of(cached))


class UNet(nn.Module):
    """Seven blocks of two convolutions: three levels down, the bottleneck, three levels up with skips.

    Attributes
    ----------
    widths : sequence of int
        Channels of each block.
    """

    def __init__(self, inputs: int, widths: tuple[int, int, int], dropout: float = 0.0) -> None:
        super().__init__()
        a, b, c = widths
        self.widths = (a, b, c, c, c, b, a)
        self.blocks = nn.ModuleList(map(block, (inputs, a, b, c, c + c, c + b, b + a), self.widths))
        self.dropout = nn.Dropout2d(dropout)

    def forward(self, x: Tensor, spreads: Sequence[Tensor], after: Callable[[int, Tensor], Tensor]) -> list[Tensor]:
        """What each block gives, once ``after(its number, its output)`` has activated it.

        ``spreads``: see ``Guidance``.
        """
        found: list[Tensor] = []
        for number, convolve in enumerate(self.blocks):
            if number > HALVINGS:
                skip = found[2 * HALVINGS - number]
                x = torch.cat([functional.interpolate(x, scale_factor=2.0), skip], 1)
            x = after(number, convolve(x))
            if number > HALVINGS:
                x = self.dropout(x)
            found.append(x)
            if number < HALVINGS:
                x = functional.avg_pool2d(x, 2) * spreads[number]
        return found


class Attention(nn.Module):
    """Each texel takes values from all others, as geometry alone decides.

    Softmax in single precision. Where there are more than ``most`` texels, k×k of them are one key and the mean of
    their values: memory then grows with the picture, not with its square.
    """

    def __init__(self, geometry: int, shading: int, heads: int, most: int) -> None:
        super().__init__()
        if heads < 1 or geometry % heads or shading % heads or most < 1:
            raise ValueError(f"{heads} heads for {geometry} and {shading} channels, at most {most} keys")
        self.heads, self.most = heads, most
        self.query, self.key = (nn.Conv2d(geometry, geometry, 1, bias=False) for _ in range(2))
        self.value = nn.Conv2d(shading, shading, 1, bias=False)

    def weights(self, geometry: Tensor, surface: Tensor) -> Tensor:
        """What each texel takes from each key, shape (B, heads, texels, keys); geometry [B, C, h, w]."""
        geometry, surface = geometry.float(), surface.float()
        queries = self._split(functional.conv2d(geometry, self.query.weight.float()))
        keys = self._split(self._pool(functional.conv2d(geometry, self.key.weight.float()), surface))
        logits = queries.transpose(2, 3) @ keys / queries.shape[2] ** 0.5
        seen = self._pool(surface, surface).flatten(2).unsqueeze(1)
        return torch.softmax(logits + (1 - seen) * HIDDEN, dim=-1)

    def forward(self, x: Tensor, weights: Tensor, surface: Tensor) -> Tensor:
        """What each texel of x [B, runs, C, h, w] gets, of the same shape; all runs in one product."""
        shape, runs = x.shape, int(x.shape[1])
        values = self._split(self._pool(self.value(x.flatten(0, 1)), surface.repeat_interleave(runs, 0)))
        values = torch.unflatten(values, 0, (-1, runs)).transpose(1, 2).flatten(2, 3)
        taken = values.float() @ weights.transpose(2, 3)
        taken = torch.unflatten(taken, 2, (runs, -1)).transpose(1, 2)
        return taken.reshape(shape).to(x.dtype)

    def _split(self, x: Tensor) -> Tensor:
        """By head: (B, heads, C / heads, texels)."""
        return torch.unflatten(x.flatten(2), 1, (self.heads, -1))

    def _pool(self, x: Tensor, surface: Tensor) -> Tensor:
        """Means over the surfaces among k×k texels each."""
        h, w = x.shape[2:]
        k = torch.as_tensor(h * w / self.most).sqrt().ceil().long()
        down, across = _groups(h, k).to(x), _groups(w, k).to(x)
        total = down @ (x * surface) @ across.t()
        return total / (down @ surface @ across.t()).clamp(min=1)


def pyramid(raw: Tensor, surface: Tensor) -> tuple[list[Tensor], list[Tensor], list[Tensor]]:
    """Means of ``raw`` over surfaces, surfaces and spreads, from full size down; see ``Guidance``."""
    raws: list[Tensor] = []
    surfaces: list[Tensor] = []
    spreads: list[Tensor] = []
    for _ in range(LEVELS):
        raw = raw * surface
        share = functional.avg_pool2d(surface, 2, ceil_mode=True)
        for found, tensor in zip((raws, surfaces, spreads), (raw, surface, 1 / share.clamp(min=0.25)), strict=True):
            found.append(tensor)
        raw, surface = functional.avg_pool2d(raw, 2, ceil_mode=True) * spreads[-1], share.sign()
    return raws, surfaces, spreads


def block(inputs: int, outputs: int) -> nn.Sequential:
    """Two convolutions; the second is activated by whoever runs it."""
    return nn.Sequential(nn.Conv2d(inputs, outputs, 3, padding=1), nn.LeakyReLU(SLOPE),
                         nn.Conv2d(outputs, outputs, 3, padding=1))


def _groups(count: Any, k: Tensor) -> Tensor:
    """1 where one of ``count`` in a row belongs to a group of k, shape (groups, count)."""
    of_each = torch.arange(count).div(k, rounding_mode="floor")
    return of_each == torch.arange((count + k - 1).div(k, rounding_mode="floor")).unsqueeze(1)
