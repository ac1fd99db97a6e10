"""``python -m app doctor``: what draws and infers here, what is missing, a self test, and times."""

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from app.cli.options import AUTO, Provider, refuse_folder
from app.cli.report import YARDSTICK
from app.io.atomic_files import prepare_folders, write_text
from app.io.terminal import print_table
from app.settings import parse_size

WRONG = 1  # exit code when something needed is missing or gives wrong results


def doctor(
    size: Annotated[str, typer.Option(help="Size of the measured frames.", metavar="WxH")] = "1024x768",
    provider: Provider = AUTO,
    json_file: Annotated[Path | None, typer.Option(
        "--json", help="Also write everything to this file.", metavar="FILE")] = None,
) -> None:
    """Say what draws and infers on this machine and what is missing, test it, and measure frames.

    The exit code is 1 if something that every picture needs is missing or gives wrong results.

    [bold]Examples[/bold]

    [cyan]python -m app doctor[/cyan]  [dim]# some ten seconds[/dim]

    [cyan]python -m app doctor --provider cuda --json doctor.json[/cyan]  [dim]# with all times of all passes[/dim]
    """
    from app import __version__
    from app.bench.machine import processor_name
    from app.doctor.findings import look_around

    measured_size = parse_size(size)
    if json_file is not None:
        refuse_folder(json_file, "--json", "JSON")
        prepare_folders(json_file.parent)
    findings = list(look_around())
    report: dict[str, Any] = {"afterglow": __version__, "processor": processor_name(),
                              "cores": len(os.sched_getaffinity(0)), "findings": [asdict(f) for f in findings]}
    typer.echo(f"afterglow {__version__} on {report['processor']}, {report['cores']} cores")
    for finding in findings:
        typer.echo(f"{finding.topic}: {finding.text}" + (f" ({finding.remedy})" if finding.remedy else ""))
    broken = any(finding.is_error for finding in findings)
    if not broken:
        report |= _test_and_measure(measured_size, provider)
        broken = not all(check["passed"] for check in report["checks"])
    if json_file is not None:
        write_text(json_file, json.dumps(report, indent=2) + "\n")
    if broken:
        raise typer.Exit(WRONG)


def _test_and_measure(size: tuple[int, int], provider: str) -> dict[str, Any]:
    """The results of the self test and all times, which are also printed."""
    from app.doctor.measurements import measure_frames, measure_transfers
    from app.doctor.self_test import run_self_test

    checks = run_self_test(provider)
    for check in checks:
        typer.echo(f"{'passed' if check.passed else 'FAILED'}: {check.name}, {check.text}")
    transfers, frames = measure_transfers(size), measure_frames(size, provider)
    device = frames["device"]
    typer.echo(f"the network runs on {device['provider']}; exchange of its tensors with OpenGL: {device['exchange']}")
    print_table(_times(frames, transfers, size))
    return {"checks": [asdict(check) for check in checks], "size": size, "transfers_ms": transfers, "frames": frames}


def _times(frames: Mapping[str, Any], transfers: Mapping[str, float], size: tuple[int, int]) -> Table:
    table = Table(f"a frame of the embedded box, {size[0]}x{size[1]}, moving camera")
    for column in ("CPU ms", "GPU ms"):
        table.add_column(column, justify="right")
    rows: Iterable[tuple[str, Mapping[str, Any]]] = (*frames["passes"].items(), ("frame", frames["frame"]))
    for name, clocks in rows:
        label = "(a full-screen copy)" if name == YARDSTICK else name
        table.add_row(label, *(f"{clocks[clock]['median']:.2f}" for clock in ("cpu_ms", "gpu_ms")))
    table.add_section()
    for name, milliseconds in transfers.items():
        table.add_row(name, f"{milliseconds:.2f}", "")
    return table
