"""What a run tells afterwards: the timing file and the summary table."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from app.atomic import write_text

Stats = Mapping[str, Any]


def write_timing(path: Path, report: Mapping[str, Any]) -> None:
    """Write the timing report as JSON, in one step."""
    write_text(path, json.dumps(report, indent=2) + "\n")


def print_summary(report: Mapping[str, Any], files: Sequence[Path], *, check: bool) -> None:
    """Print a table with the median times of each pass and of the frame, and the files written.

    Parameters
    ----------
    report : mapping
        As in the timing file.
    files : sequence of Path
        In the order in which they were written.
    check : bool
        Whether non-finite texels were counted.
    """
    console = Console(highlight=False)
    width, height = report["size"]
    table = Table(title=f"{report['scene']}, {width}x{height}, network {report['model'] or 'none'}",
                  caption=f"{report['device']['gl_renderer']}, {report['device']['provider']}")
    table.add_column("pass")
    table.add_column("CPU ms", justify="right")
    table.add_column("GPU ms", justify="right")
    if check:
        table.add_column("non-finite", justify="right")
    for name, stats in report["passes"].items():
        table.add_row(name, *_times(stats), *([str(stats["non_finite"])] if check else []))
    table.add_section()
    table.add_row("frame", *_times(report["frame"]))
    console.print(table)
    console.print(Text("wrote " + (" … ".join(map(str, (files[0], files[-1]))) if len(files) > 2 else
                                   ", ".join(map(str, files)))), soft_wrap=True)


def _times(stats: Stats) -> list[str]:
    return [_median(stats.get(clock)) for clock in ("cpu_ms", "gpu_ms")]


def _median(clock: Stats | None) -> str:
    return "–" if clock is None or clock["median"] is None else f"{clock['median']:.2f}"
