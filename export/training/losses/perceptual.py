"""Distance between images in the features of a VGG network."""

import re
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from app.errors import SettingsError

MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of ImageNet, on which VGG networks are trained
_KERNEL = re.compile(r"features\.(\d+)\.weight")


class Perceptual(nn.Module):
    """Mean absolute difference of VGG features (Johnson et al. 2016, "Perceptual Losses for Real-Time Style Transfer").

    Parameters
    ----------
    weights : Path
        State of a VGG without batch norm, as saved by torchvision: ``features.N.weight`` and ``.bias``. The numbers
        give the layers: each convolution is followed by a ReLU, and by pooling if the next number is skipped.

    Raises
    ------
    SettingsError
        When the file can't be read or does not hold such a network.
    """

    def __init__(self, weights: Path) -> None:
        super().__init__()
        kernels = _kernels(weights)
        at = sorted(kernels)
        self.pooled = [after - number > 2 for number, after in pairwise([*at, at[-1] + 2])]
        for number in at:
            for name, tensor in zip(("kernel", "bias"), kernels[number], strict=True):
                self.register_buffer(f"{name}{number}", tensor, persistent=False)
        self.at = at

    def forward(self, a: Tensor, b: Tensor) -> Tensor:
        """Mean over all levels; ``a`` and ``b`` are [B, 3, h, w] with values from 0 to 1."""
        self.to(a.device)
        mean, deviation = (torch.tensor(x).reshape(1, 3, 1, 1).to(a) for x in (MEAN, DEVIATION))
        x, differences = (torch.cat([a, b]).float() - mean) / deviation, []
        for number, pool in zip(self.at, self.pooled, strict=True):
            kernel, bias = self.get_buffer(f"kernel{number}"), self.get_buffer(f"bias{number}")
            x = functional.relu(functional.conv2d(x, kernel, bias, padding=1))
            if pool:
                differences.append(_difference(x))
                x = functional.max_pool2d(x, 2)
        return torch.stack([*differences, _difference(x)]).mean()


def _difference(features: Tensor) -> Tensor:
    a, b = features.chunk(2)
    return (a - b).abs().mean()


def _kernels(weights: Path) -> dict[int, tuple[Tensor, Tensor]]:
    """Kernel and bias of each convolution, by its number."""
    try:
        state: Mapping[str, Tensor] = torch.load(weights, map_location="cpu", weights_only=True)
        numbers = [int(m[1]) for name in state if (m := _KERNEL.fullmatch(name))]
        kernels = {n: (state[f"features.{n}.weight"].float(), state[f"features.{n}.bias"].float()) for n in numbers}
    except Exception as error:  # torch raises many types for damaged files
        raise SettingsError(f"can't read the network ({type(error).__name__})", weights,
                            "expected the state of a VGG network, saved by torch") from None
    channels = 3
    for number in sorted(kernels):
        kernel, bias = kernels[number]
        if kernel.shape != (len(bias), channels, 3, 3):
            raise SettingsError(f"features.{number}.weight has the shape {list(kernel.shape)}", weights,
                                f"expected 3x3 kernels of {channels} channels: a VGG network without batch norm")
        channels = len(bias)
    if not kernels:
        raise SettingsError("no tensor features.N.weight", weights, "expected the state of a VGG network")
    return kernels
