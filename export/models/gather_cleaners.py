"""Other networks that clean gathered light: with the parts of published ones, and for ablations."""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import torch
from torch import Tensor, nn
from torch.nn import functional

from export.models import bcnn
from export.models.attention import MAX_KEYS, Attention
from export.models.final_gather import CORNERS, FEATURES, OUTPUTS, FinalGather, Texels, conv
from export.models.network import MAX_LOGIT, NEGATIVE_SLOPE

DEPTH = FEATURES - 1       # index of the feature, log2(depth) / 4
GEOMETRY = 4               # features: normal, depth; the last ones
HEADS = 4
NARROW, WIDE = (8, 16, 16), (32, 64, 64)


class BcnnGather(FinalGather):
    """Its U-Net's convolutions are bilateral (Xin et al. 2021): the difference of depths weights their taps."""

    paper = "Xin et al. 2021, with kernels as in Bako et al. 2017; docs/ablations.md"

    def _make_body(self, inputs: int, widths: Sequence[int]) -> nn.Module:
        return BilateralUNet(inputs, widths)


class GfaGather(FinalGather):
    """An encoder of geometry modulates its U-Net and computes attention (Gai, Wang and Li 2025)."""

    paper = "Gai, Wang and Li 2025, with kernels as in Bako et al. 2017; docs/ablations.md"

    def _make_body(self, inputs: int, widths: Sequence[int]) -> nn.Module:
        return AttentiveUNet(inputs, widths)


class BilateralUNet(nn.Module):
    """As ``final_gather.UNet``, of bilateral convolutions."""

    def __init__(self, inputs: int, widths: Sequence[int]) -> None:
        super().__init__()
        a, b, c = widths
        self.down = nn.ModuleList([bcnn.Block(inputs, a), bcnn.Block(a, b), bcnn.Block(b, c)])
        self.up = nn.ModuleList([bcnn.Block(c + b, b), bcnn.Block(b + a, a)])

    def forward(self, x: Tensor, surface: Tensor) -> Tensor:
        depth = (4 * math.log(2) * x[:, CORNERS * DEPTH:]).exp() * surface
        count = surface.sum(1, keepdim=True)
        levels = bcnn.pyramid(depth.sum(1, keepdim=True) / count.clamp(min=1), count.sign(), len(self.up))
        skips: list[Tensor] = []
        for block, finer, level in zip(self.down, (None, *levels), levels, strict=False):
            if finer is not None:
                x = functional.avg_pool2d(x * finer.surface, 2) * finer.pool_scale
            x = block(x, level.taps)
            skips.append(x)
        for block, level, skip in zip(self.up, levels[-2::-1], skips[-2::-1], strict=True):
            x = block(torch.cat([functional.interpolate(x, scale_factor=2.0), skip], 1), level.taps)
        return x


class AttentiveUNet(nn.Module):
    """Three levels of light, each modulated by those of geometry, with attention between all texels of the coarsest."""

    def __init__(self, inputs: int, widths: Sequence[int]) -> None:
        super().__init__()
        a, b, c = widths
        geometry = CORNERS * GEOMETRY
        self.geometry = nn.ModuleList([conv(geometry, a), conv(a, b), conv(b, c)])
        self.down = nn.ModuleList([conv(inputs - geometry, a), conv(a, b), conv(b, c)])
        self.up = nn.ModuleList([conv(c + b, b), conv(b + a, a)])
        self.modulations = nn.ModuleList(nn.Conv2d(width, 2 * width, 1) for width in (a, b, c, b, a))
        self.attention = Attention(c, c, HEADS, MAX_KEYS)

    def forward(self, x: Tensor, surface: Tensor) -> Tensor:
        light, guide = x[:, :-CORNERS * GEOMETRY], x[:, -CORNERS * GEOMETRY:]
        surface = surface.amax(1, keepdim=True)
        guides: list[Tensor] = []
        skips: list[Tensor] = []
        for level, (encode, convolve) in enumerate(zip(self.geometry, self.down, strict=True)):
            if level:
                light, guide = functional.avg_pool2d(light, 2), functional.avg_pool2d(guide, 2)
                surface = functional.avg_pool2d(surface, 2).sign()
            guide = functional.leaky_relu(encode(guide), NEGATIVE_SLOPE)
            light = self._modulate(level, convolve(light), guide)
            guides.append(guide)
            skips.append(light)
        weights = self.attention.weights(guide, surface)
        light = light + self.attention(light.unsqueeze(1), weights, surface).squeeze(1)
        for level, convolve in enumerate(self.up):
            skip, guide = skips[-2 - level], guides[-2 - level]
            light = torch.cat([functional.interpolate(light, scale_factor=2.0), skip], 1)
            light = self._modulate(len(self.down) + level, convolve(light), guide)
        return light

    def _modulate(self, block: int, x: Tensor, guide: Tensor) -> Tensor:
        scale, shift = self.modulations[block](guide).chunk(2, dim=1)
        return functional.leaky_relu(x * (1 + scale) + shift, NEGATIVE_SLOPE)


class DirectGather(FinalGather):
    """Predicts light instead of kernels, for ablations; not linear in light, and two parameters do nothing."""

    def _light(self, x: Tensor, texels: Texels) -> Tensor:
        colors, _ = self._logits(x, [3, OUTPUTS - 3])
        return functional.softplus(torch.cat(colors, 1)).clamp(max=MAX_LOGIT).exp() - 1


CLEANERS: Mapping[str, Callable[[], FinalGather]] = {
    "final-gather": FinalGather,
    "bcnn-gather": partial(BcnnGather, "bcnn-gather"),
    "gfa-gather": partial(GfaGather, "gfa-gather"),
    "narrow-gather": partial(FinalGather, "narrow-gather", NARROW),
    "wide-gather": partial(FinalGather, "wide-gather", WIDE),
    "direct-gather": partial(DirectGather, "direct-gather"),
    "no-prior-gather": partial(FinalGather, "no-prior-gather", reads_prior=False),
}
