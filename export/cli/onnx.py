"""``python -m export onnx`` and ``stamp``: networks with their contracts inside."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.contract import ModelContract
from app.errors import ModelError
from app.paths import nets_dir
from export.cli.options import known_networks


def onnx(names: Annotated[list[str] | None, typer.Argument(help="Networks to export; all without any.")] = None,
         out: Annotated[Path | None, typer.Option(help="Folder to write to; nets/ by default.")] = None) -> None:
    """Export networks with their contracts, checked against torch."""
    from export.to_onnx import export_network

    for name in known_networks(names):
        print(export_network(name, out or nets_dir()))


def stamp(model: Annotated[Path, typer.Argument(help="An .onnx file; it is rewritten.")],
          contract: Annotated[Path, typer.Argument(help="JSON file with the contract.")]) -> None:
    """Put a contract into an .onnx file."""
    from export.to_onnx import stamp as stamp_file

    try:
        text = contract.read_text()
    except OSError as error:
        raise ModelError(f"can't read the contract ({error.strerror})", contract, "expected a JSON file") from None
    stamp_file(model, ModelContract.from_json(text, contract))
