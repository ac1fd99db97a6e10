"""Checkpoints: the complete state of a training run in one file, replaced atomically."""

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from app.bench.machine import processor_name
from app.errors import ModelError
from app.io.atomic_files import replace_file
from export.models import Network, make_network
from export.training.config import Config, config_from_table

VERSION = 4


@dataclass
class Progress:
    """Progress of a run.

    Attributes
    ----------
    step : int
        Number of completed steps.
    seconds : float
        Training time over all sessions.
    validation : dict of str to float
        Latest loss on the held-out pairs: its terms and their sum ``loss``.
    """

    step: int = 0
    seconds: float = 0.0
    validation: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Checkpoint:
    """Contents of a checkpoint.

    Attributes
    ----------
    discriminator : dict
        State of the loss's discriminator; empty without one.
    facts : dict
        Further facts for the model card: pairs of the dataset, weights, machine, versions and date.
    """

    config: Config
    progress: Progress
    model: dict[str, Tensor]
    ema: dict[str, Tensor]
    optimizer: dict[str, Any]
    discriminator: dict[str, Any]
    facts: dict[str, Any]

    def network(self) -> Network:
        """The network with the averaged weights, in evaluation mode."""
        network = make_network(self.config.network.preset, self.config.network.options)
        prefix = "module."  # added by AveragedModel
        network.load_state_dict({k.removeprefix(prefix): x for k, x in self.ema.items() if k.startswith(prefix)})
        network.eval()
        return network


def save_checkpoint(path: Path, config: Config, progress: Progress, model: nn.Module, ema: nn.Module,
                    optimizer: torch.optim.Optimizer, discriminator: dict[str, Any], facts: dict[str, Any]) -> None:
    """Write ``path`` atomically."""
    state = {"version": VERSION, "config": config.to_json(), "progress": vars(progress), "model": model.state_dict(),
             "ema": ema.state_dict(), "optimizer": optimizer.state_dict(), "discriminator": discriminator,
             "facts": {**facts, "torch": str(torch.__version__), "written": time.strftime("%Y-%m-%d")}}
    with replace_file(path) as temporary:
        torch.save(state, temporary)


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint.

    Raises
    ------
    ModelError
        When the file is missing, is not a checkpoint, or has another version.
    """
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
        if (version := state.pop("version")) != VERSION:
            raise ModelError(f"made by another version ({version})", path,
                             f"expected {VERSION}; make it again with python -m export train and a new --out")
        config = config_from_table(state.pop("config"), path)
        return Checkpoint(config=config, progress=Progress(**state.pop("progress")), **state)
    except ModelError:
        raise
    except OSError as error:
        raise ModelError(f"can't read the checkpoint ({error.strerror})", path, "expected a file") from None
    except Exception as error:  # torch raises many types for damaged files
        raise ModelError(f"not a checkpoint ({type(error).__name__})", path,
                         f"expected a file of export train, version {VERSION}") from None


def machine_name(device: torch.device) -> str:
    """Name of the GPU, or of the processor with its thread count."""
    if device.type == "cuda":
        return torch.cuda.get_device_name(device)
    return f"{processor_name()}, {torch.get_num_threads()} threads"
