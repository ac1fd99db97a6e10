"""``python -m export skies``: errors of what shades an environment."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from export.cli.tables import print_table


def skies(
    models: Annotated[list[str] | None, typer.Argument(
        metavar="[MODEL]…", help="none, coarse, names of bundled networks and paths.",
        show_default="none coarse")] = None,
    truth: Annotated[Path | None, typer.Option(
        help="Folder that keeps the path-traced truth; the benchmark's cache without.", metavar="DIR")] = None,
    scenes: Annotated[Path | None, typer.Option(
        help="Folder of the scene files; ../shared/scenes without.", metavar="DIR")] = None,
    spp: Annotated[int, typer.Option(help="Samples per pixel of the truth, which is denoised.", min=8)] = 256,
    out: Annotated[Path, typer.Option(help="Folder for skies.csv.", metavar="DIR")] = Path("out/skies"),
) -> None:
    """Judge light straight from an environment on open views of the validation list; prints means of each scene."""
    from app.atomic import prepare_folders, write_text
    from app.bench.tables import to_csv
    from app.bench.truth import cache_folder
    from export.sky_judge import METRICS, by_scene, judge, sky_views
    from export.validation import SCENES

    prepare_folders(out)
    rows = judge(sky_views(scenes or SCENES), models or ["none", "coarse"], spp, truth or cache_folder() / "skies",
                 lambda line: typer.secho(line, err=True, dim=True))
    write_text(out / "skies.csv", to_csv(rows))
    shown = Table("scene", "views", "model", *METRICS, box=box.SIMPLE)
    for row in by_scene(rows):
        shown.add_row(row["scene"], str(row["views"]), row["model"], *(f"{row[name]:.3f}" for name in METRICS))
    print_table(shown)
