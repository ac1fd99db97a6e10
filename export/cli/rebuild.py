"""``python -m export rebuild``: every network, from an empty folder."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from app.paths import nets_dir

CONFIGS = Path(__file__).parents[1] / "configs"
QUICK_DATA, SKY_DATA = (Path(__file__).parents[1] / "dataset" / f"{name}.toml" for name in ("quick", "sky"))
# Configurations.
TRAINED = ("bcnn-8", "bcnn-8-single", "gfa-8", "surround-16", "surround-16-front")
UNDER_SKY, QUICK = ("ndr-8",), ("quick",)
PAIRS, SKY_PAIRS, QUICK_PAIRS = 1500, 768, 12


def rebuild(work: Annotated[Path, typer.Option(help="Folder of the dataset and of the training runs.",
                                               metavar="DIR")],
            out: Annotated[Path | None, typer.Option(
                help="Folder of the networks, and of the cards of trained ones; without, nets/, and with --quick one "
                     "in --work.", metavar="DIR")] = None,
            quick: Annotated[bool, typer.Option("--quick", help="Minutes, not hours: a dozen small pairs, and two "
                                                "epochs of the smallest network; nothing worth using.")] = False,
            ) -> None:
    """Make the dataset, train on it and export all networks; goes on where it was stopped."""
    for arguments in steps(work, out or (work / "nets" if quick else nets_dir()), quick):
        command = [sys.executable, "-m", "export", *map(str, arguments)]
        typer.secho(f"$ {shlex.join(['python', *command[1:]])}", err=True, bold=True)
        failed = subprocess.run(command).returncode
        if failed:
            raise typer.Exit(failed)


def steps(work: Path, out: Path, quick: bool) -> Iterator[Sequence[object]]:
    """The commands, without ``python -m export``."""
    data, sky = work / "data", work / "sky"
    if quick:
        yield "dataset", "--out", data, "--frames", QUICK_PAIRS, "--config", QUICK_DATA
    else:
        yield "dataset", "--out", data, "--frames", PAIRS
        yield "dataset", "--out", sky, "--frames", SKY_PAIRS, "--config", SKY_DATA
    yield "onnx", "--out", out
    for name in QUICK if quick else (*TRAINED, *UNDER_SKY):
        yield "train", CONFIGS / f"{name}.toml", "--dataset", sky if name in UNDER_SKY else data, "--out", work / name
        yield "onnx", work / name / "checkpoint.pt", "--out", out
