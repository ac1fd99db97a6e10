"""``python -m export dataset``: pairs of neighbouring frames with path-traced targets."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn


def dataset(out: Annotated[Path, typer.Option(help="Folder of the dataset; what is there and sound is kept.",
                                              metavar="DIR")],
            frames: Annotated[int, typer.Option(help="Pairs of neighbouring frames.", min=1, metavar="N")],
            config: Annotated[Path | None, typer.Option(help="What it is made of; a mix of sources without.",
                                                        metavar="FILE.toml")] = None,
            seed: Annotated[int, typer.Option(help="Other numbers give other scenes.", min=0)] = 0,
            scheduler: Annotated[str | None, typer.Option(help="A Dask scheduler; this machine's cores without.",
                                                          metavar="tcp://…")] = None,
            workers: Annotated[int | None, typer.Option(help="Processes on this machine; one for each core without.",
                                                        min=1)] = None) -> None:
    """Make a dataset, or what is missing, corrupt or outdated in one. It may be stopped at any moment."""
    from export.dataset.config import read_config
    from export.dataset.run import make_dataset
    from export.mitsuba_scene import mitsuba

    mitsuba()  # says what is missing, if anything is
    chosen = read_config(config)
    columns = (TextColumn("pairs"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("pairs", total=frames)
        made = make_dataset(out, chosen, seed, frames, scheduler, workers, lambda n: bar.advance(task, n))
    print(f"{out}: {frames} pairs, {made} of them made now")
