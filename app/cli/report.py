"""The summary table of a run."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

YARDSTICK = "copy"  # a full-screen copy, for comparison
CLOCKS = {"cpu_ms": "CPU ms", "gpu_ms": "GPU ms"}


def print_summary(report: Mapping[str, Any], images: Sequence[Path], timing: Path | None, *, check: bool) -> None:
    """Print the median time of a frame and the written files, and what was measured of each pass.

    Parameters
    ----------
    report : mapping
        As in the timing file.
    images : sequence of Path
        In the order in which they were written.
    timing : Path or None
        The timing file; without one, passes were not timed.
    check : bool
        Whether non-finite texels were counted.
    """
    console = Console(highlight=False)
    width, height = report["size"]
    (frame_ms,) = _times(report["frame"], ("cpu_ms",))
    for line in (
        f"{report['scene']}, {report['triangles']} triangles, {width}x{height}, model {report['model'] or 'none'}",
        f"{report['device']['gl_renderer']}, {report['device']['provider']}",
        _table(report, CLOCKS if timing else {}, check=check) if timing or check else f"{frame_ms} ms per frame",
        "wrote " + ", ".join([_range(images), *([str(timing)] if timing else [])]),
    ):
        console.print(line, soft_wrap=True, markup=False)


def _table(report: Mapping[str, Any], clocks: Mapping[str, str], *, check: bool) -> Table:
    table = Table("pass")
    for column in (*clocks.values(), *(["non-finite"] if check else [])):
        table.add_column(column, justify="right")
    for name, stats in report["passes"].items():
        if name != YARDSTICK:
            table.add_row(name, *_times(stats, clocks), *([str(stats["non_finite"])] if check else []))
    if clocks:
        table.add_section()
        table.add_row("frame", *_times(report["frame"], clocks))
        table.add_row("(a full-screen copy)", *_times(report["passes"][YARDSTICK], clocks))
    return table


def _range(images: Sequence[Path]) -> str:
    return ", ".join(map(str, images)) if len(images) <= 2 else f"{images[0]} … {images[-1]} ({len(images)} images)"


def _times(stats: Mapping[str, Any], clocks: Iterable[str]) -> list[str]:
    """Median milliseconds of each clock."""
    return [f"{stats[clock]['median']:.2f}" if stats[clock] else "–" for clock in clocks]
