"""``python -m export train``: train a network as a configuration says."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn


def train(config: Annotated[Path, typer.Argument(help="What to do; export/configs/ has those of shipped networks.",
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
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
               TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), disable=not sys.stderr.isatty()) as bar:
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
