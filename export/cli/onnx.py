"""``python -m export onnx`` and ``stamp``: networks with their contracts inside."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from app.contract import ModelContract
from app.errors import ModelError
from app.paths import nets_dir
from export.cli.options import known_networks


class Precision(StrEnum):
    """Of tensors and weights."""

    SINGLE = "float32"
    HALF = "float16"


def onnx(networks: Annotated[list[str] | None, typer.Argument(
             help="Checkpoints of export train (.pt), or networks without weights; all of these without any.")] = None,
         precision: Annotated[list[Precision] | None, typer.Option(
             help="Of a checkpoint's files; both without. May be given more than once.")] = None,
         out: Annotated[Path | None, typer.Option(help="Folder to write to; nets/ by default.")] = None) -> None:
    """Export networks with their contracts, checked against torch; trained ones with a model card."""
    from export.to_onnx import export_checkpoint, export_network
    from export.training.state import load

    folder = out or nets_dir()
    checkpoints = [name for name in networks or () if name.endswith(".pt")]
    names = [name for name in networks or () if name not in checkpoints]
    for path in checkpoints:
        for made in export_checkpoint(load(Path(path)), folder, precision or tuple(Precision)):
            print(made)
    for name in known_networks(names) if names or not checkpoints else ():
        print(export_network(name, folder))


def stamp(model: Annotated[Path, typer.Argument(help="An .onnx file; it is rewritten.")],
          contract: Annotated[Path, typer.Argument(help="JSON file with the contract.")]) -> None:
    """Put a contract into an .onnx file."""
    from export.to_onnx import stamp as stamp_file

    try:
        text = contract.read_text()
    except OSError as error:
        raise ModelError(f"can't read the contract ({error.strerror})", contract, "expected a JSON file") from None
    stamp_file(model, ModelContract.from_json(text, contract))
