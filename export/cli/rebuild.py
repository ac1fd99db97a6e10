"""``python -m export rebuild``: every network, from an empty folder."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from app.paths import nets_dir

CONFIGS = Path(__file__).parents[1] / "configs"
DATA = Path(__file__).parents[1] / "dataset"


@dataclass(frozen=True)
class Part:
    """A dataset, of a configuration beside ``export.dataset``, and what is trained on it."""

    dataset: str
    pairs: int
    trained: tuple[str, ...]


WHOLE = (Part("default", 1500, ("bcnn-8", "bcnn-8-single", "gfa-8")),
         Part("around", 2200, ("surround-16", "surround-16-front")),
         Part("sky", 768, ("ndr-8",)))
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
        typer.secho(f"$ {shlex.join(['python', *command[1:]])}", err=True, bold=True)
        failed = subprocess.run(command).returncode
        if failed:
            raise typer.Exit(failed)


def steps(work: Path, out: Path, quick: bool) -> Iterator[Sequence[object]]:
    """The commands, without ``python -m export``."""
    parts = QUICK if quick else WHOLE
    for part in parts:
        yield "dataset", "--out", work / part.dataset, "--frames", part.pairs, "--config", DATA / f"{part.dataset}.toml"
    yield "onnx", "--out", out
    for part in parts:
        for name in part.trained:
            run = work / "runs" / name
            yield "train", CONFIGS / f"{name}.toml", "--dataset", work / part.dataset, "--out", run
            yield "onnx", run / "checkpoint.pt", "--out", out
