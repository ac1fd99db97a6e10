"""``python -m export``: datasets, training, ONNX files, path-traced references and validation."""

import sys

import typer

from app.errors import AfterglowError
from export.dataset.cli import cli as dataset
from export.onnx.cli import cli as onnx
from export.reference.cli import reference
from export.training.cli import rebuild, train
from export.validation.cli import cli as validate

cli = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__, pretty_exceptions_enable=False)
cli.add_typer(dataset, name="dataset")
cli.command()(train)
cli.add_typer(onnx, name="onnx")
cli.command()(reference)
cli.add_typer(validate, name="validate")
cli.command()(rebuild)


if __name__ == "__main__":
    try:
        cli()
    except AfterglowError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
