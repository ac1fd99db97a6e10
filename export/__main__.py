"""``python -m export``: write the bundled networks, or put a contract into somebody else's."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from app.contract import ModelContract
from app.errors import AfterglowError, ModelError
from app.paths import nets_dir
from export.to_onnx import MODULES, export_network
from export.to_onnx import stamp as stamp_file

cli = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__)


@cli.command()
def onnx(names: Annotated[list[str] | None, typer.Argument(help="Networks to export; all without any.")] = None,
         out: Annotated[Path | None, typer.Option(help="Folder to write to; nets/ by default.")] = None) -> None:
    """Export networks with their contracts, checked against torch."""
    for name in names or MODULES:
        if name not in MODULES:
            raise ModelError(f"no network {name!r}", "export onnx", f"expected one of {', '.join(MODULES)}")
        print(export_network(name, out or nets_dir()))


@cli.command()
def stamp(model: Annotated[Path, typer.Argument(help="An .onnx file; it is rewritten.")],
          contract: Annotated[Path, typer.Argument(help="JSON file with the contract.")]) -> None:
    """Put a contract into an .onnx file."""
    try:
        text = contract.read_text()
    except OSError as error:
        raise ModelError(f"can't read the contract ({error.strerror})", contract, "expected a JSON file") from None
    stamp_file(model, ModelContract.from_json(text, contract))


if __name__ == "__main__":
    try:
        cli()
    except AfterglowError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
