"""``python -m export validate``: errors of models on the validation views."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from export.cli.tables import print_table


def validate(
    models: Annotated[list[str] | None, typer.Argument(
        metavar="[MODEL]…", help="none, ssgi, names of bundled networks and paths; all without any.")] = None,
    truth: Annotated[Path | None, typer.Option(
        help="Folder that keeps the path-traced truth; the benchmark's cache without.", metavar="DIR")] = None,
    scenes: Annotated[Path | None, typer.Option(
        help="Folder of the scene files; ../shared/scenes without.", metavar="DIR")] = None,
    only: Annotated[list[str] | None, typer.Option(help="Views of these scenes only.", metavar="SCENE")] = None,
    spp: Annotated[int, typer.Option(help="Paths per pixel of the truth, which is denoised.", min=8)] = 128,
    constant: Annotated[float | None, typer.Option(
        help="Also judge radiosity times this factor.", min=0.0, metavar="FACTOR")] = None,
    fit: Annotated[Path | None, typer.Option(
        help="Also judge radiosity times the factor that suits this dataset best.", metavar="DATASET")] = None,
    oracle: Annotated[bool, typer.Option(
        "--oracle", help="Also judge each model with its light as strong as suits each view best.")] = False,
    time: Annotated[str | None, typer.Option(help="Also time frames of this size.", metavar="WxH")] = None,
    cards: Annotated[bool, typer.Option(
        "--cards", help="Also write what was found into the model card beside each network.")] = False,
    provider: Annotated[str, typer.Option(help="onnxruntime execution provider.", metavar="auto|cpu|cuda|…")] = "auto",
    out: Annotated[Path, typer.Option(help="Folder for validation.csv, .json and .md.",
                                      metavar="DIR")] = Path("out/validation"),
) -> None:
    """Judge models, and the oracle ambient light, on the validation views; prints means of each scene."""
    from app.atomic import prepare_folders, write_text
    from app.bench.configurations import all_models
    from app.bench.tables import to_csv
    from app.contract import find_model
    from app.errors import SettingsError
    from app.settings import Settings, parse_size
    from export.card_figures import cards_of, write_figures
    from export.constant import fitted_constant
    from export.dataset import Dataset
    from export.frame_times import frame_times
    from export.judge import SCALED, by_view, judge, to_json
    from export.validation import SCENES, views
    from export.validation_table import HEADER, table, to_markdown

    def tell(line: str) -> None:
        typer.secho(line, err=True, dim=True)

    size = Settings(parse_size(time)).size if time is not None else None
    if cards and only:
        raise SettingsError("--cards with some scenes alone", "--only", "expected all views for a model card")
    judged = models or all_models()
    written = cards_of(judged) if cards else {}
    chosen = views(scenes or SCENES, only or ())
    if not chosen:
        raise SettingsError(f"no view of {', '.join(only or ())}", "--only", "expected scenes of the validation list")
    prepare_folders(out)
    if fit is not None:
        network = find_model(SCALED)
        assert isinstance(network, Path)
        pairs = Dataset(fit)
        if pairs.config.environment:
            raise SettingsError("a dataset of environments", fit, "expected one with indirect light")
        constant = fitted_constant(pairs, network, pairs=200)
    rows = judge(chosen, judged, spp, truth, constant, provider, tell, oracle)
    times = frame_times(chosen, judged, size, provider, tell) if size is not None else None
    write_text(out / "validation.csv", to_csv(by_view(rows)))
    about = {"spp": spp, "constant": constant, "times": times and asdict(times)}
    write_text(out / "validation.json", to_json(rows, about))
    write_text(out / "validation.md", to_markdown(rows, times))
    write_figures(written, rows, spp, times)
    shown = Table(*HEADER, box=box.SIMPLE)
    for line in table(rows, times):
        shown.add_row(*line)
    print_table(shown)
