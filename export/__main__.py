"""``python -m export``: datasets, training, ONNX files, path-traced references and validation."""

import sys

import typer

from app.errors import AfterglowError
from app.settings import command_line_error
from export.dataset.cli import cli as dataset
from export.onnx.cli import cli as onnx
from export.onnx.gather_cli import cli as gather
from export.reference.cli import reference
from export.training.cli import rebuild, train
from export.validation.cli import cli as validate

cli = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__, pretty_exceptions_enable=False)
cli.add_typer(dataset, name="dataset")
cli.command()(train)
cli.add_typer(gather, name="gather")
cli.add_typer(onnx, name="onnx")
cli.command()(reference)
cli.add_typer(validate, name="validate")
cli.command()(rebuild)


def main() -> None:
    """Run the command line; print a user's error as one line, as ``python -m app`` does, and exit with code 2."""
    try:
        sys.exit(cli(standalone_mode=False))
    except AfterglowError as error:
        message = command_line_error(error)
    except typer.TyperException as error:
        text = error.format_message()
        message = text and f"command line: {text[:1].lower()}{text[1:].rstrip('. ')} (--help lists the options)"
    except typer.Abort:
        sys.exit(1)
    if message:  # it is empty after the help of a group
        typer.echo(typer.style("error:", fg="red", bold=True) + " " + " ".join(message.split()), err=True)
    sys.exit(2)


if __name__ == "__main__":
    main()
