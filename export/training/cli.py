"""``python -m export train``: train a network as a configuration says."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from app.io.terminal import counting_progress, say
from app.paths import nets_dir

CONFIGS = Path(__file__).with_name("configs")
DATA = Path(__file__).parents[1] / "dataset" / "configs"


def train(config: Annotated[Path, typer.Argument(help="What to do; export/training/configs/ has those of shipped networks.",
                                                 metavar="CONFIG.toml")],
          out: Annotated[Path, typer.Option(help="Folder of the run; one with a checkpoint is continued.",
                                            metavar="DIR")],
          dataset: Annotated[Path | None, typer.Option(help="Instead of the configuration's.", metavar="DIR")] = None,
          workers: Annotated[int | None, typer.Option(help="Processes that draw inputs; one for each core without.",
                                                      min=1)] = None) -> None:
    """Train a network; it may be stopped at any moment and continued by the same command."""
    from export.training.process import tune

    tune()
    from app.errors import SettingsError
    from export.dataset import Dataset
    from export.training.config import read_config
    from export.training.eligible import eligible
    from export.training.examples import draw_missing, examples_for
    from export.training.loop import Run, network_and_loss

    chosen = read_config(config, dataset)
    pairs = Dataset(chosen.data.dataset)
    network, loss = network_and_loss(chosen)
    contract = network.contract
    if pairs.config.environment != contract.shades_environment:
        kind = "an environment" if contract.shades_environment else "lights"
        raise SettingsError("a dataset of other light", chosen.data.dataset, f"expected scenes under {kind}, which "
                            f"{contract.name} is for (key environment of the dataset's configuration)")
    with counting_progress() as bar:
        examples = examples_for(pairs, contract, loss.uses_previous)
        if examples.missing:
            task = bar.add_task("drawing", total=len(examples.missing))
            for count in draw_missing(pairs, contract, examples.previous, workers):
                bar.advance(task, count)
        run = Run(chosen, examples, out, eligible(pairs, chosen.data.most_saturated))
        task = bar.add_task("training", total=run.steps, completed=run.progress.step)
        found = run.train(lambda step, steps, terms: bar.update(
            task, completed=step, description=f"training, loss {terms['loss']:.4f}"))
    print(f"{out}: {run.steps} steps, loss on held-out pairs {found['loss']:.4f}")


@dataclass(frozen=True)
class Part:
    """A dataset, of a configuration beside ``export.dataset``, and what is trained on it."""

    dataset: str
    pairs: int
    trained: tuple[str, ...]


WHOLE = (Part("default", 1500, ("bcnn-8", "bcnn-8-single", "gfa-8")),
         Part("surround", 2200, ("surround-16",)),
         Part("environment", 768, ("ndr-8",)))
QUICK = (Part("quick", 12, ("quick",)),)


def rebuild(work: Annotated[Path, typer.Option(help="Folder of the datasets and of the training runs.",
                                               metavar="DIR")],
            out: Annotated[Path | None, typer.Option(
                help="Folder of the networks, and of the cards of trained ones; without, nets/, and with --quick one "
                     "in --work.", metavar="DIR")] = None,
            quick: Annotated[bool, typer.Option("--quick", help="Minutes, not hours: a dozen small pairs, and two "
                                                "epochs of the smallest network; nothing worth using.")] = False,
            ) -> None:
    """Make the datasets, train on them and export all networks; goes on where it was stopped."""
    for arguments in steps(work, out or (work / "nets" if quick else nets_dir()), quick):
        command = [sys.executable, "-m", "export", *map(str, arguments)]
        say(f"$ {shlex.join(['python', *command[1:]])}")
        failed = subprocess.run(command).returncode
        if failed:
            raise typer.Exit(failed)


def steps(work: Path, out: Path, quick: bool) -> Iterator[Sequence[object]]:
    """The commands, without ``python -m export``."""
    parts = QUICK if quick else WHOLE
    for part in parts:
        yield "dataset", "make", "--out", work / part.dataset, "--frames", part.pairs, "--config", DATA / f"{part.dataset}.toml"
    yield "onnx", "write", "--out", out
    for part in parts:
        for name in part.trained:
            run = work / "runs" / name
            yield "train", CONFIGS / f"{name}.toml", "--dataset", work / part.dataset, "--out", run
            yield "onnx", "write", run / "checkpoint.pt", "--out", out
