"""Data augmentation: random exposure, scene size, order of colours, and mirroring."""

from collections.abc import Callable

import torch
from torch import Tensor

from app.environment import ORDER
from app.network.channels import CHANNELS, CUBE, SCREEN, SEEN, Channel
from app.network.contract import ModelContract, TensorSpec
from export.training.config import AugmentationConfig
from export.training.examples import Batch

HARMONICS = "environment.sh"
# (x + iy)ᵐ becomes (-1)ᵐ (x - iy)ᵐ when the sign of x changes.
MIRRORED_HARMONICS = [(-1.0) ** (m if m >= 0 else m + 1) for n in range(ORDER + 1) for m in range(-n, n + 1)]
MIRRORED_FACES = [0, 1, 3, 2, 4, 5]  # left and right swapped


def augment(batch: Batch, contract: ModelContract, config: AugmentationConfig, random: torch.Generator) -> Batch:
    """``batch`` with independent random changes of each example."""
    count = len(batch["target"])
    stops = config.exposure_stops * (2 * torch.rand(count, generator=random) - 1)
    order = torch.stack([torch.randperm(3, generator=random) for _ in range(count)])
    flip = torch.rand(count, generator=random) < 0.5
    batch = scale_light(batch, contract, 2**stops)
    if config.size_stops > 0:
        batch = scale_lengths(batch, contract, 2**(config.size_stops * (2 * torch.rand(count, generator=random) - 1)))
    if config.permute_colors:
        batch = permute_colors(batch, contract, order)
    if config.mirror:
        mirrored = mirror(batch, contract)
        batch = {name: torch.where(_expand(flip.to(x.device), x), mirrored[name], x) for name, x in batch.items()}
    return batch


def subsample(batch: Batch, contract: ModelContract, stride: int) -> Batch:
    """Every ``stride``-th texel of the screen, across and down; motion is converted to the new texels."""
    off_screen = {name for name, spec in _inputs(batch, contract) if spec.grid != SCREEN}
    scalars = {name for name, x in batch.items() if x.shape[-2:] == (1, 1)}
    out = {name: x if name in off_screen | scalars else x[..., ::stride, ::stride] for name, x in batch.items()}
    if "motion" in out:
        out["motion"] = out["motion"] / stride
    return out


def scale_lengths(batch: Batch, contract: ModelContract, factor: Tensor) -> Batch:
    """Multiply all lengths by ``factor`` [B]; light does not change."""
    return _scale_channels(batch, contract, factor, lambda channel: channel.unit == "extent")


def scale_light(batch: Batch, contract: ModelContract, factor: Tensor) -> Batch:
    """Multiply all light by ``factor`` [B]."""
    out = _scale_channels(batch, contract, factor, lambda channel: channel.radiance)
    out["target"] = batch["target"] * _expand(factor.to(batch["target"]), batch["target"])
    return out


def permute_colors(batch: Batch, contract: ModelContract, order: Tensor) -> Batch:
    """Reorder red, green and blue by the ``order`` [B, 3] of each example."""
    out = dict(batch)
    for name, spec in _inputs(batch, contract):
        at = torch.arange(spec.components).repeat(len(order), 1)
        for channel, rows in spec.rows():
            if channel.endswith(".rgb"):
                at[:, rows] = rows.start + order
            elif channel == HARMONICS:
                at[:, rows] = rows.start + (25 * order[:, :, None] + torch.arange(25)).flatten(1)
        out[name] = _reorder(batch[name], at)
    for name in {"target", "reflectance"} & batch.keys():
        thirds = 3 * torch.arange(batch[name].shape[1] // 3)
        out[name] = _reorder(batch[name], (thirds[None, :, None] + order[:, None, :]).flatten(1))
    return out


def mirror(batch: Batch, contract: ModelContract) -> Batch:
    """Swap left and right: images, the x of vectors, the faces of cubes, and motion."""
    not_images = {name for name, spec in _inputs(batch, contract) if spec.grid not in SEEN}
    out = {name: x if name in not_images or x.shape[-1] == 1 else x.flip(-1) for name, x in batch.items()}
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
        out[name] = x * _expand(sign.to(x), x)
    return out


def _scale_channels(batch: Batch, contract: ModelContract, factor: Tensor, which: Callable[[Channel], bool]) -> Batch:
    """Multiply the input channels that ``which`` selects by ``factor`` [B]."""
    out = dict(batch)
    for name, spec in _inputs(batch, contract):
        scale = torch.ones(len(factor), spec.components)
        for channel, rows in spec.rows():
            if which(CHANNELS[channel]):
                scale[:, rows] = factor[:, None]
        out[name] = batch[name] * _expand(scale.to(batch[name]), batch[name])
    return out


def _inputs(batch: Batch, contract: ModelContract) -> list[tuple[str, TensorSpec]]:
    frames = {name.partition(".")[0] for name in batch} & {"current", "previous"}
    return [(f"{frame}.{t}", spec) for frame in frames for t, spec in contract.inputs.items()]


def _expand(x: Tensor, tensor: Tensor) -> Tensor:
    """``x`` with trailing axes of length 1 up to the rank of ``tensor``, for broadcasting."""
    return x.reshape(*x.shape, *[1] * (tensor.dim() - x.dim()))


def _reorder(x: Tensor, at: Tensor) -> Tensor:
    """Reorder the channels of each example by ``at`` [B, C]."""
    return torch.stack([example[order] for example, order in zip(x, at.to(x.device), strict=True)])
