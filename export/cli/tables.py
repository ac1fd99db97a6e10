"""Tables on the terminal."""

from __future__ import annotations

import sys

from rich.console import Console
from rich.table import Table

WIDTH = 120  # wherever it is printed


def print_table(table: Table) -> None:
    """Print ``table`` as plain text of fixed width."""
    Console(highlight=False, file=sys.stdout, width=WIDTH).print(table)
