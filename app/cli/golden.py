"""``python -m app golden``: keep and compare what every pass writes."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich import box
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from app.cli.options import unknown

if TYPE_CHECKING:
    from app.golden import Case, Finding, Report

FOLDER = Path("tests/golden/images")
FAILED = 1

Names = Annotated[list[str] | None, typer.Argument(metavar="[SCENE]...", help="Some scenes of the catalogue.",
                                                   show_default="all")]
Folder = Annotated[Path, typer.Option("--golden", metavar="DIR", help="Folder of the golden images.")]

golden = typer.Typer(no_args_is_help=True, rich_markup_mode="rich",
                     help="Keep golden images of every pass, and compare with them.")


@golden.command("check")
def check_command(names: Names = None, folder: Folder = FOLDER) -> None:
    """Compare every pass with its golden images; exit code 1 when one differs.

    Each generated scene is drawn twice, which must give the same bits. A golden that is missing, or that no pass
    writes, is a failure too.

    [bold]Examples[/bold]

    [cyan]python -m app golden check[/cyan]  [dim]# all scenes[/dim]

    [cyan]python -m app golden check room --golden /tmp/before[/cyan]  [dim]# one scene, other goldens[/dim]
    """
    from app.golden import catalogue, check, orphan_cases

    cases = _chosen(names)
    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("drawing", total=len(cases))
        report = check(cases, folder, progress=lambda name: bar.update(task, description=name, advance=1))
    if not names:
        report.findings.extend(orphan_cases(folder, catalogue()))
    _print(report)
    if report.broken:
        raise typer.Exit(FAILED)


@golden.command("update")
def update_command(names: Names = None, folder: Folder = FOLDER) -> None:
    """Draw the scenes and make the result the golden images; look at what changed before you commit it.

    [bold]Examples[/bold]

    [cyan]python -m app golden update[/cyan]  [dim]# all scenes[/dim]
    """
    from app.golden import catalogue, update

    files = update(_chosen(names), folder, catalogue())
    size = sum(file.stat().st_size for file in files)
    typer.echo(f"wrote {len(files)} images, {size / 1e6:.1f} MB, to {folder}")


def _chosen(names: list[str] | None) -> list[Case]:
    from app.golden import catalogue

    known = catalogue()
    for name in names or ():
        if name not in known:
            raise unknown(name, known, "golden")
    return [known[name] for name in names or known]


def _print(report: Report) -> None:
    from app.golden.compare import OTHER_RENDERER, SAME_RENDERER

    console = Console(highlight=False)
    console.print(report.renderer, soft_wrap=True, markup=False)
    for case, origin in report.foreign.items():
        console.print(f"{case}: the goldens come from {origin}, so the wider tolerance holds", soft_wrap=True,
                      markup=False)
    table = Table("scene", "stage", "resource", box=box.SIMPLE)
    for column in ("difference", "off"):
        table.add_column(column, justify="right")
    table.add_column("verdict")
    for finding in _worst(report.findings):
        table.add_row(finding.case, finding.stage or "–", finding.resource, f"{finding.difference:.2g}",
                      f"{finding.share:.2%}", f"[{'green' if finding.ok else 'bold red'}]{finding.verdict}[/]")
    console.print(table)
    for name, tolerance in (("same renderer", SAME_RENDERER), ("another one", OTHER_RENDERER)):
        console.print(f"tolerance, {name}: a texel is off beyond {tolerance.difference:g} of 1 + |golden|, "
                      f"and {tolerance.share:.2%} of the texels may be", style="dim", soft_wrap=True)
    for case in dict.fromkeys(f.case for f in report.broken):
        first = next(f for f in report.broken if f.case == case)
        console.print(f"first broken stage of {case}: {first.stage or '–'} ({first.resource}, {first.verdict})",
                      soft_wrap=True, markup=False)


def _worst(findings: list[Finding]) -> list[Finding]:
    """The worst finding of each stage, and every file that belongs to none, in their order."""
    worst: dict[tuple[str, str], Finding] = {}
    for f in findings:
        key = (f.case, f.stage or f.resource)
        if key not in worst or (f.ok, -f.difference) < (worst[key].ok, -worst[key].difference):
            worst[key] = f
    return list(worst.values())
