"""``python -m export walks``: the light of models over time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from export.cli.tables import print_table

SPP, QUICK_SPP = 256, 16


def walks(
    models: Annotated[list[str] | None, typer.Argument(
        metavar="[MODEL]…", help="none, ssgi, names of bundled networks and paths; ssgi and all networks without any.",
    )] = None,
    truth: Annotated[Path | None, typer.Option(
        help="Folder that keeps the path-traced truth; the benchmark's cache without.", metavar="DIR")] = None,
    scenes: Annotated[Path | None, typer.Option(
        help="Folder of the scene files; ../shared/scenes without.", metavar="DIR")] = None,
    spp: Annotated[int | None, typer.Option(
        help=f"Paths per pixel of the truth; {SPP}, or {QUICK_SPP} with --quick, without.", min=2, metavar="N")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer frames, small and noisy.")] = False,
    provider: Annotated[str, typer.Option(help="onnxruntime execution provider.", metavar="auto|cpu|cuda|…")] = "auto",
    out: Annotated[Path, typer.Option(help="Folder for walks.json and a plot of each walk.",
                                      metavar="DIR")] = Path("out/walks"),
) -> None:
    """Judge models while the camera moves: is their light steady, and does it stay when what is lit is behind?"""
    from app.atomic import prepare_folders, write_text
    from app.bench.configurations import NONE, all_models
    from export.validation import SCENES
    from export.walk_judge import QUICK_SIZE, SIZE, judge_walks, plot, to_json
    from export.walks import walks as all_walks

    prepare_folders(out)
    chosen = models or [name for name in all_models() if name != NONE]
    size, spp = QUICK_SIZE if quick else SIZE, spp or (QUICK_SPP if quick else SPP)
    rows = judge_walks(all_walks(scenes or SCENES, quick), chosen, size, spp, truth, provider,
                       lambda line: typer.secho(line, err=True, dim=True))
    write_text(out / "walks.json", to_json(rows, {"size": size, "spp": spp}))
    verdicts = {True: "yes", False: "no", None: "too noisy"}
    table = Table("walk", "model", "change", "of truth's", "mean", "gradient", "astray", "holds", box=box.SIMPLE)
    for row in rows:
        table.add_row(row.walk, row.model, "" if row.error is None else f"{row.error:.2%}",
                      "" if row.error_ratio is None else f"{row.error_ratio:.2f}", f"{row.mean:.3f}",
                      "" if row.gradient is None else f"{row.gradient:.3f}", f"{row.astray:.1%}", verdicts[row.holds])
    print_table(table)
    for name in dict.fromkeys(row.walk for row in rows):
        plot([row for row in rows if row.walk == name], out / f"{name}.png")
