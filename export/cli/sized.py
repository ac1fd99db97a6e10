"""``python -m export sized``: networks for benchmarks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def sized(out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("sized")) -> None:
    """Export networks of rising surfel count and width, without trained weights, to time them."""
    from export.sized import write_sized

    for path in write_sized(out):
        print(path)
