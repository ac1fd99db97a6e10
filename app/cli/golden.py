"""``python -m app golden``: golden images of what every pass writes."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from app.cli.options import check_name, refuse_folder
from app.errors import SettingsError
from app.io.atomic_files import prepare_folders, write_text
from app.io.terminal import print_table, transient_progress

if TYPE_CHECKING:
    from app.golden import Case, Finding, Report

FOLDER = Path("tests/golden/images")
REPORT = Path("out/golden.html")
FAILED = 1

Names = Annotated[list[str] | None, typer.Argument(metavar="[SCENE]...", help="Scenes of the catalogue.",
                                                   show_default="all")]
Catalogue = Annotated[Path | None, typer.Option(
    "--catalogue", metavar="FILE.json", help="Your own scenes and models; needs --golden.",
    show_default="the generated scenes")]
Folder = Annotated[Path | None, typer.Option("--golden", metavar="DIR", help="Folder of the golden images.",
                                             show_default=str(FOLDER))]

golden = typer.Typer(no_args_is_help=True, rich_markup_mode="rich",
                     help="Keep golden images of every pass, and compare with them.")


@golden.command("check")
def check_command(
    names: Names = None, catalogue: Catalogue = None, folder: Folder = None,
    report: Annotated[Path | None, typer.Option(
        "--report", metavar="FILE.html", help="Page with golden, current and difference image of each failed stage.",
        show_default=f"{REPORT}, on failure")] = None,
) -> None:
    """Compare every pass with its golden images; exit code 1 if one differs.

    Each scene is drawn twice, which must give the same bits. Missing golden
    images and files that no pass writes are failures too. On another renderer
    than that of the golden images a wider tolerance applies.

    [bold]Examples[/bold]

    [cyan]python -m app golden check[/cyan]  [dim]# all generated scenes[/dim]

    [cyan]python -m app golden check room --golden /tmp/before[/cyan]  [dim]# one scene, other golden images[/dim]

    [cyan]python -m app golden check --catalogue mine.json --golden mine/[/cyan]  [dim]# your scenes and networks[/dim]
    """
    from app.golden import check, orphan_cases, page

    known, folder = _known(catalogue), _folder(catalogue, folder)
    cases = _chosen(names, known)
    if report is not None:
        refuse_folder(report, "--report", "HTML")
        prepare_folders(report.parent)
    with transient_progress() as bar:
        task = bar.add_task("drawing", total=len(cases))
        results = check(cases, folder, progress=lambda name: bar.update(task, description=name, advance=1))
    if not names:
        results.findings.extend(orphan_cases(folder, known))
    _print(results)
    if results.broken or report is not None:
        path = report or REPORT
        prepare_folders(path.parent)
        write_text(path, page(results))
        typer.echo(f"wrote {path}")
    if results.broken:
        raise typer.Exit(FAILED)


@golden.command("update")
def update_command(
    names: Names = None, catalogue: Catalogue = None, folder: Folder = None,
    looked: Annotated[bool, typer.Option(
        "--i-looked", help="Also overwrite golden images of another renderer; compare them with the new ones first.",
    )] = False,
) -> None:
    """Draw the scenes and save the results as golden images; review the changes before you commit them.

    The networks' input tensors are not updated; delete tensor_*.exr in
    SCENE.network to save new ones.

    [bold]Examples[/bold]

    [cyan]python -m app golden update[/cyan]  [dim]# all generated scenes[/dim]

    [cyan]python -m app golden update hall --catalogue mine.json --golden mine/[/cyan]  [dim]# one of your own[/dim]
    """
    from app.golden import update

    known, folder = _known(catalogue), _folder(catalogue, folder)
    files = update(_chosen(names, known), folder, known, overwrite_foreign=looked)
    size = sum(file.stat().st_size for file in files)
    typer.echo(f"wrote {len(files)} images, {size / 1e6:.1f} MB, to {folder}")


def _known(path: Path | None) -> dict[str, Case]:
    from app.golden import catalogue, read_catalogue

    return catalogue() if path is None else read_catalogue(path)


def _folder(catalogue: Path | None, folder: Path | None) -> Path:
    """The folder of the golden images; a user's scenes must not be mixed with the generated ones."""
    if catalogue is not None and folder is None:
        raise SettingsError("no folder for the catalogue's golden images", "--golden", "expected --golden DIR")
    return folder or FOLDER


def _chosen(names: list[str] | None, known: dict[str, Case]) -> list[Case]:
    for name in names or ():
        check_name(name, known, "SCENE")
    return [known[name] for name in names or known]


def _print(report: Report) -> None:
    console = Console(highlight=False)

    def say(text: str, style: str = "") -> None:
        console.print(text, style=style, soft_wrap=True, markup=False)

    for origin in report.origins:
        say(origin)
    for case, origin in report.foreign.items():
        say(f"{case}: the goldens come from {origin}, so the wider tolerance applies")
    others = [f for f in report.findings if f.verdict != "same"]
    say(f"{len(report.findings) - len(others)} of {len(report.findings)} images are the same")
    if others:
        print_table(_table(others))
        say("difference: maximum of |current - golden| / (1 + |golden|); off: share of texels beyond tolerance", "dim")
    if importlib.util.find_spec("flip_evaluator") is None:
        say("no FLIP: pip install 'afterglow[evaluation]'", "dim")
    for case in dict.fromkeys(f.case for f in report.broken):
        first = next(f for f in report.broken if f.case == case)
        say(f"first broken stage of {case}: {first.stage or '–'} ({first.resource}, {first.verdict})")


def _table(findings: list[Finding]) -> Table:
    table = Table("scene", "stage", "resource", box=box.SIMPLE)
    for column in ("difference", "off", "FLIP"):
        table.add_column(column, justify="right")
    table.add_column("verdict")
    for f in findings:
        table.add_row(f.case, f.stage or "–", f.resource, f"{f.distance.difference:.2g}", f"{f.distance.share:.2%}",
                      "–" if f.distance.flip is None else f"{f.distance.flip:.4f}",
                      f"[{'green' if f.ok else 'bold red'}]{f.verdict}[/]")
    return table
