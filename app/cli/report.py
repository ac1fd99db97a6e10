"""The summary table of a run."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

YARDSTICK = "copy"  # a full-screen copy, for comparison


def print_summary(report: Mapping[str, Any], images: Sequence[Path], timing: Path | None, *, check: bool) -> None:
    """Print a table with the median times of each pass and of the frame, and the written files.

    Parameters
    ----------
    report : mapping
        As in the timing file.
    images : sequence of Path
        In the order in which they were written.
    timing : Path or None
        The timing file, if there is one.
    check : bool
        Whether non-finite texels were counted.
    """
    console = Console(highlight=False)
    width, height = report["size"]
    table = Table("pass")
    for column in ("CPU ms", "GPU ms", *(["non-finite"] if check else [])):
        table.add_column(column, justify="right")
    for name, stats in report["passes"].items():
        if name != YARDSTICK:
            table.add_row(name, *_times(stats), *([str(stats["non_finite"])] if check else []))
    table.add_section()
    table.add_row("frame", *_times(report["frame"]))
    if YARDSTICK in report["passes"]:
        table.add_row("(a full-screen copy)", *_times(report["passes"][YARDSTICK]))
    for line in (
        f"{report['scene']}, {report['triangles']} triangles, {width}x{height}, model {report['model'] or 'none'}",
        f"{report['device']['gl_renderer']}, {report['device']['provider']}",
        table,
        "wrote " + ", ".join([_range(images), *([str(timing)] if timing else [])]),
    ):
        console.print(line, soft_wrap=True, markup=False)


def _range(images: Sequence[Path]) -> str:
    return ", ".join(map(str, images)) if len(images) <= 2 else f"{images[0]} … {images[-1]} ({len(images)} images)"


def _times(stats: Mapping[str, Any]) -> list[str]:
    """Median milliseconds of CPU and GPU."""
    return [f"{clock['median']:.2f}" if clock else "–" for clock in (stats["cpu_ms"], stats["gpu_ms"])]
