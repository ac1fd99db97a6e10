"""``python -m export``: datasets, networks and their judgement, and the path-traced truth. A file per command."""

from __future__ import annotations

import sys

import typer

from app.errors import AfterglowError
from export.cli.dataset import dataset
from export.cli.linearity import linearity
from export.cli.models import models
from export.cli.onnx import onnx, stamp
from export.cli.precision import precision
from export.cli.rebuild import rebuild
from export.cli.reference import reference
from export.cli.sized import sized
from export.cli.skies import skies
from export.cli.train import train
from export.cli.validate import validate
from export.cli.walks import walks

cli = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__, pretty_exceptions_enable=False)
for command in (dataset, train, models, onnx, stamp, rebuild, sized, precision, linearity, reference, validate, walks,
                skies):
    cli.command()(command)


if __name__ == "__main__":
    try:
        cli()
    except AfterglowError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
