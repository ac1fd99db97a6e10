"""Random changes under which the answer stays right: exposure, size, colours, left and right."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from app.environment import ORDER
from app.network.channels import CHANNELS, CUBE, SCREEN, SEEN, Channel
from app.network.contract import ModelContract, TensorSpec
from export.training.config import AugmentationConfig
from export.training.examples import Batch

HARMONICS = "environment.sh"
# (x + iy)ᵐ becomes (-1)ᵐ (x - iy)ᵐ where x changes its sign.
MIRRORED_HARMONICS = [(-1.0) ** (m if m >= 0 else m + 1) for n in range(ORDER + 1) for m in range(-n, n + 1)]
MIRRORED_FACES = [0, 1, 3, 2, 4, 5]  # left and right change places


def augment(batch: Batch, contract: ModelContract, config: AugmentationConfig, random: torch.Generator) -> Batch:
    """``batch`` with each example changed in its own way."""
    count = len(batch["target"])
    stops = config.exposure_stops * (2 * torch.rand(count, generator=random) - 1)
    order = torch.stack([torch.randperm(3, generator=random) for _ in range(count)])
    flip = torch.rand(count, generator=random) < 0.5
    batch = exposed(batch, contract, 2**stops)
    if config.size_stops > 0:
        batch = sized(batch, contract, 2**(config.size_stops * (2 * torch.rand(count, generator=random) - 1)))
    if config.permute_colors:
        batch = permuted(batch, contract, order)
    if config.mirror:
        other = mirrored(batch, contract)
        batch = {name: torch.where(_over(flip.to(x.device), x), other[name], x) for name, x in batch.items()}
    return batch


def coarser(batch: Batch, contract: ModelContract, every: int) -> Batch:
    """Each ``every``-th texel of the screen, across and down, with motion in the new texels."""
    other = {name for name, spec in _inputs(batch, contract) if spec.grid != SCREEN}
    whole = {name for name, x in batch.items() if x.shape[-2:] == (1, 1)}  # one number for the frame
    out = {name: x if name in other | whole else x[..., ::every, ::every] for name, x in batch.items()}
    if "motion" in out:
        out["motion"] = out["motion"] / every
    return out


def sized(batch: Batch, contract: ModelContract, factor: Tensor) -> Batch:
    """All lengths multiplied by ``factor`` [B]; the light stays."""
    return _multiplied(batch, contract, factor, lambda channel: channel.unit == "extent")


def exposed(batch: Batch, contract: ModelContract, factor: Tensor) -> Batch:
    """All light multiplied by ``factor`` [B]."""
    out = _multiplied(batch, contract, factor, lambda channel: channel.radiance)
    out["target"] = batch["target"] * _over(factor.to(batch["target"]), batch["target"])
    return out


def permuted(batch: Batch, contract: ModelContract, order: Tensor) -> Batch:
    """Red, green and blue in the ``order`` [B, 3] of each example."""
    out = dict(batch)
    for name, spec in _inputs(batch, contract):
        at = torch.arange(spec.components).repeat(len(order), 1)
        for channel, rows in spec.rows():
            if channel.endswith(".rgb"):
                at[:, rows] = rows.start + order
            elif channel == HARMONICS:
                at[:, rows] = rows.start + (25 * order[:, :, None] + torch.arange(25)).flatten(1)
        out[name] = _reordered(batch[name], at)
    for name in {"target", "reflectance"} & batch.keys():
        thirds = 3 * torch.arange(batch[name].shape[1] // 3)
        out[name] = _reordered(batch[name], (thirds[None, :, None] + order[:, None, :]).flatten(1))
    return out


def mirrored(batch: Batch, contract: ModelContract) -> Batch:
    """Left and right exchanged: images, the x of vectors, a cube's faces, and motion."""
    points = {name for name, spec in _inputs(batch, contract) if spec.grid not in SEEN}
    out = {name: x if name in points or x.shape[-1] == 1 else x.flip(-1) for name, x in batch.items()}
    if "motion" in out:
        out["motion"] = out["motion"] * torch.tensor([-1.0, 1.0], device=out["motion"].device).reshape(1, 2, 1, 1)
    for name, spec in _inputs(batch, contract):
        sign = torch.ones(1, spec.components)
        for channel, rows in spec.rows():
            if channel.endswith(".xyz"):
                sign[:, rows.start] = -1
            elif channel == HARMONICS:
                sign[:, rows] = torch.tensor(MIRRORED_HARMONICS).repeat(3)
        x = out[name][:, :, MIRRORED_FACES] if spec.grid == CUBE else out[name]
        out[name] = x * _over(sign.to(x), x)
    return out


def _multiplied(batch: Batch, contract: ModelContract, factor: Tensor, which: Callable[[Channel], bool]) -> Batch:
    """Channels of the inputs multiplied by ``factor`` [B]."""
    out = dict(batch)
    for name, spec in _inputs(batch, contract):
        scale = torch.ones(len(factor), spec.components)
        for channel, rows in spec.rows():
            if which(CHANNELS[channel]):
                scale[:, rows] = factor[:, None]
        out[name] = batch[name] * _over(scale.to(batch[name]), batch[name])
    return out


def _inputs(batch: Batch, contract: ModelContract) -> list[tuple[str, TensorSpec]]:
    frames = {name.partition(".")[0] for name in batch} & {"current", "previous"}
    return [(f"{frame}.{t}", spec) for frame in frames for t, spec in contract.inputs.items()]


def _over(x: Tensor, tensor: Tensor) -> Tensor:
    """``x`` with as many axes as ``tensor``, so that it is broadcast over the last ones."""
    return x.reshape(*x.shape, *[1] * (tensor.dim() - x.dim()))


def _reordered(x: Tensor, at: Tensor) -> Tensor:
    """Channels of each example in the order ``at`` [B, C]."""
    return torch.stack([example[order] for example, order in zip(x, at.to(x.device), strict=True)])
