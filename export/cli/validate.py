"""``python -m export validate``: errors of models on the validation views."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from export.cli.tables import print_table

COLUMNS = {"final.psnr": "PSNR", "final.ssim": "SSIM", "final.rel_mse": "relMSE", "final.flip": "FLIP",
           "indirect.psnr": "ind. PSNR", "indirect.ssim": "SSIM", "indirect.rel_mse": "relMSE",
           "indirect.flip": "FLIP"}


def validate(
    models: Annotated[list[str] | None, typer.Argument(
        metavar="[MODEL]…", help="none, ssgi, names of bundled networks and paths; all without any.")] = None,
    truth: Annotated[Path | None, typer.Option(
        help="Folder that keeps the path-traced truth; the benchmark's cache without.", metavar="DIR")] = None,
    scenes: Annotated[Path | None, typer.Option(
        help="Folder of the scene files; ../shared/scenes without.", metavar="DIR")] = None,
    only: Annotated[list[str] | None, typer.Option(help="Views of these scenes only.", metavar="SCENE")] = None,
    spp: Annotated[int, typer.Option(help="Paths per pixel of the truth.", min=8)] = 256,
    constant: Annotated[float | None, typer.Option(
        help="Also judge radiosity times this factor.", min=0.0, metavar="FACTOR")] = None,
    fit: Annotated[Path | None, typer.Option(
        help="Also judge radiosity times the factor that suits this dataset best.", metavar="DATASET")] = None,
    oracle: Annotated[bool, typer.Option(
        "--oracle", help="Also judge each model with its light as strong as suits each view best.")] = False,
    provider: Annotated[str, typer.Option(help="onnxruntime execution provider.", metavar="auto|cpu|cuda|…")] = "auto",
    out: Annotated[Path, typer.Option(help="Folder for validation.csv and validation.json.",
                                      metavar="DIR")] = Path("out/validation"),
) -> None:
    """Judge models, and the oracle ambient light, on the validation views; prints means of each scene."""
    from app.atomic import prepare_folders, write_text
    from app.bench.configurations import all_models
    from app.bench.tables import to_csv
    from app.contract import find_model
    from app.errors import SettingsError
    from export.constant import fitted_constant
    from export.dataset import Dataset
    from export.judge import SCALED, by_scene, by_view, judge, to_json
    from export.validation import SCENES, views

    chosen = views(scenes or SCENES, only or ())
    if not chosen:
        raise SettingsError(f"no view of {', '.join(only or ())}", "--only", "expected scenes of the validation list")
    prepare_folders(out)
    if fit is not None:
        network = find_model(SCALED)
        assert isinstance(network, Path)
        constant = fitted_constant(Dataset(fit), network, pairs=200)
    rows = judge(chosen, models or all_models(), spp, truth, constant, provider,
                 lambda line: typer.secho(line, err=True, dim=True), oracle)
    write_text(out / "validation.csv", to_csv(by_view(rows)))
    write_text(out / "validation.json", to_json(rows, {"spp": spp, "constant": constant}))
    table = Table("scene", "model", *COLUMNS.values(), box=box.SIMPLE)
    for row in by_scene(rows):
        table.add_row(row["scene"], row["model"], *(f"{row[key]:.3g}" for key in COLUMNS))
    print_table(table)
