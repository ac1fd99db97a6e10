"""All that a training run is at some step, in one file that appears whole."""

from __future__ import annotations

import platform
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from app.errors import ModelError
from app.io.atomic_files import replacing
from export.models import Network, make_network
from export.training.config import Config, from_table

VERSION = 3


@dataclass
class Progress:
    """How far a run is.

    Attributes
    ----------
    step : int
        Steps taken.
    seconds : float
        Spent training, over all times that it was resumed.
    validation : dict of str to float
        The newest loss on the held-out pairs, by term and ``loss``.
    """

    step: int = 0
    seconds: float = 0.0
    validation: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Checkpoint:
    """What ``save`` has written.

    Attributes
    ----------
    discriminator : dict
        State of the loss's discriminator; empty without one.
    facts : dict
        What a model card says besides: pairs of the dataset, weights, machine, versions, the day.
    """

    config: Config
    progress: Progress
    model: dict[str, Tensor]
    ema: dict[str, Tensor]
    optimizer: dict[str, Any]
    discriminator: dict[str, Any]
    facts: dict[str, Any]

    def network(self) -> Network:
        """The network with the averaged weights."""
        network = make_network(self.config.network.preset, self.config.network.options)
        prefix = "module."  # of AveragedModel
        network.load_state_dict({k.removeprefix(prefix): x for k, x in self.ema.items() if k.startswith(prefix)})
        network.eval()
        return network


def save(path: Path, config: Config, progress: Progress, model: nn.Module, ema: nn.Module,
         optimizer: torch.optim.Optimizer, discriminator: dict[str, Any], facts: dict[str, Any]) -> None:
    """Write ``path`` in one step."""
    state = {"version": VERSION, "config": config.to_json(), "progress": vars(progress), "model": model.state_dict(),
             "ema": ema.state_dict(), "optimizer": optimizer.state_dict(), "discriminator": discriminator,
             "facts": {**facts, "torch": str(torch.__version__), "written": time.strftime("%Y-%m-%d")}}
    with replacing(path) as temporary:
        torch.save(state, temporary)


def load(path: Path) -> Checkpoint:
    """Read what ``save`` has written.

    Raises
    ------
    ModelError
        When the file is missing, is no checkpoint, or one of another version.
    """
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
        if state.pop("version") != VERSION:
            raise KeyError
        config = from_table(state.pop("config"), path)
        return Checkpoint(config=config, progress=Progress(**state.pop("progress")), **state)
    except OSError as error:
        raise ModelError(f"can't read the checkpoint ({error.strerror})", path, "expected a file") from None
    except Exception as error:  # torch raises whatever a damaged file makes it raise
        raise ModelError(f"no checkpoint ({type(error).__name__})", path,
                         f"expected what export train writes, version {VERSION}") from None


def machine(device: torch.device) -> str:
    """What ``device`` is, in a few words."""
    if device.type == "cuda":
        return torch.cuda.get_device_name(device)
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        name = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        name = platform.machine()
    return f"{name}, {torch.get_num_threads()} threads"
