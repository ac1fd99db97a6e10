"""What commands print: notes, progress bars, and tables of a fixed width."""

from __future__ import annotations

import sys

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

TABLE_WIDTH = 120  # characters, wherever a table is printed


def say(line: str) -> None:
    """Print a line on the standard error stream, dimmed."""
    typer.secho(line, err=True, dim=True)


def print_table(table: Table) -> None:
    """Print ``table`` as plain text of a fixed width."""
    Console(highlight=False, file=sys.stdout, width=TABLE_WIDTH).print(table)


def counting_progress() -> Progress:
    """A progress bar with counts and times; nothing where the standard error stream is no terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
               TimeRemainingColumn())
    return Progress(*columns, console=Console(stderr=True), disable=not sys.stderr.isatty())


def transient_progress(disable: bool = False) -> Progress:
    """A progress bar that disappears when its work is done; nothing where the standard error stream is no terminal."""
    return Progress(console=Console(stderr=True), transient=True, disable=disable or not sys.stderr.isatty())
