"""What commands print: notes, progress bars and tables."""

import sys

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

TABLE_WIDTH = 120  # characters, if the output is no terminal


def say(line: str) -> None:
    """Print a line on the standard error stream, dimmed."""
    typer.secho(line, err=True, dim=True)


def note(line: str) -> None:
    """Print a note for the user on the standard error stream, dimmed."""
    say(f"note: {line}")


def print_table(table: Table) -> None:
    """Print ``table`` as wide as the terminal, or as plain text of a fixed width."""
    width = None if sys.stdout.isatty() else TABLE_WIDTH
    Console(highlight=False, file=sys.stdout, width=width).print(table)


def counting_progress() -> Progress:
    """A progress bar with counts and times; hidden if the standard error stream is no terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
               TimeRemainingColumn())
    return Progress(*columns, console=Console(stderr=True), disable=not sys.stderr.isatty())


def transient_progress(disable: bool = False) -> Progress:
    """A progress bar that disappears when its work is done; hidden if the standard error stream is no terminal."""
    return Progress(console=Console(stderr=True), transient=True, disable=disable or not sys.stderr.isatty())
