"""Rows of figures as text: CSV files, Markdown tables and numbers for people."""

import csv
import io
from collections.abc import Iterable, Mapping, Sequence


def to_csv(rows: Iterable[Mapping[str, object]]) -> str:
    """CSV with a header of all columns that occur in any row."""
    listed = list(rows)
    text = io.StringIO()
    writer = csv.DictWriter(text, list(dict.fromkeys(column for row in listed for column in row)), lineterminator="\n")
    writer.writeheader()
    writer.writerows(listed)
    return text.getvalue()


def markdown_table(head: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    """A Markdown table of texts."""
    first, *lines = (f"| {' | '.join(row)} |" for row in (head, *body))
    return "\n".join([first, "|" + "---|" * len(head), *lines])


def format_number(value: float | None, digits: int = 3) -> str:
    """Significant digits for people; None stands for the infinite PSNR of equal images."""
    return "∞" if value is None else f"{value:.{digits}g}" if abs(value) < 100 else f"{value:.0f}"
