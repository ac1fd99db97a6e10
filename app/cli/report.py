"""What a run tells afterwards: the timing file and the summary table."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from app.io.atomic_files import write_text

YARDSTICK = "copy"

Stats = Mapping[str, Any]


def write_timing(path: Path, report: Mapping[str, Any]) -> None:
    """Write the timing report as JSON, in one step."""
    write_text(path, json.dumps(report, indent=2) + "\n")


def print_summary(report: Mapping[str, Any], images: Sequence[Path], timing: Path | None, *, check: bool) -> None:
    """Print a table with the median times of each pass and of the frame, and the files written.

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
    table = Table()
    table.add_column("pass")
    table.add_column("CPU ms", justify="right")
    table.add_column("GPU ms", justify="right")
    if check:
        table.add_column("non-finite", justify="right")
    passes = {name: stats for name, stats in report["passes"].items() if name != YARDSTICK}
    for name, stats in passes.items():
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


def _times(stats: Stats) -> list[str]:
    return [_median(stats[clock]) for clock in ("cpu_ms", "gpu_ms")]


def _median(clock: Stats) -> str:
    return f"{clock['median']:.2f}" if clock else "–"
