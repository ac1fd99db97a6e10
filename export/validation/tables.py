"""What validation found, as rows of text: for the terminal and for a page of documentation."""

from __future__ import annotations

from collections.abc import Sequence

from export.validation.errors import Row, by_scene
from export.validation.timing import FrameTimes

COLUMNS = {"final.psnr": ("PSNR", ".2f"), "final.ssim": ("SSIM", ".3f"), "final.rel_mse": ("relMSE", ".3g"),
           "final.flip": ("FLIP", ".3f"), "indirect.psnr": ("indirect: PSNR", ".2f"), "indirect.ssim": ("SSIM", ".3f"),
           "indirect.rel_mse": ("relMSE", ".3g"), "indirect.flip": ("FLIP", ".3f")}
HEADER = ("scene", "model", *(name for name, _ in COLUMNS.values()), "ms")


def table(rows: Sequence[Row], times: FrameTimes | None) -> list[list[str]]:
    """A line for each model on each scene, and on all views; ``HEADER`` names the columns."""
    taken = times.milliseconds if times is not None else {}
    return [[row["scene"], row["model"], *(format(row[key], form) for key, (_, form) in COLUMNS.items()),
             f"{ms:.0f}" if (ms := taken.get(row["scene"], {}).get(row["model"])) is not None else ""]
            for row in by_scene(rows)]


def to_markdown(rows: Sequence[Row], times: FrameTimes | None) -> str:
    """The same as a Markdown table."""
    lines = [list(HEADER), ["---"] * len(HEADER), *table(rows, times)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
