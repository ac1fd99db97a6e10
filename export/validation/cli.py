"""``python -m export validate``: errors of models on the validation views, along camera paths, under environments."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from app.io.terminal import print_table, say

SPP, QUICK_SPP = 256, 16  # samples per pixel along camera paths

cli = typer.Typer(no_args_is_help=True, help="Compare models with path-traced references on held-out views.")

Models = Annotated[list[str] | None, typer.Argument(
    metavar="[MODEL]…", help="none, ssgi, names of bundled networks and paths.", show_default="all")]
References = Annotated[Path | None, typer.Option(
    "--references", help="Folder that caches the path-traced references.", metavar="DIR",
    show_default="the benchmark's cache")]
Scenes = Annotated[Path | None, typer.Option(
    help="Folder of the scene files.", metavar="DIR", show_default="../shared/scenes")]
Provider = Annotated[str, typer.Option(help="onnxruntime execution provider.", metavar="auto|cpu|cuda|…")]


@cli.command(name="views")
def compare_on_views(
    models: Models = None, references: References = None, scenes: Scenes = None,
    only: Annotated[list[str] | None, typer.Option(help="Views of these scenes only.", metavar="SCENE")] = None,
    spp: Annotated[int, typer.Option(help="Paths per pixel of the references, which are denoised.", min=8)] = 128,
    oracle: Annotated[bool, typer.Option(
        "--oracle", help="Also scale each model's light to suit each view best, and compare that.")] = False,
    time: Annotated[str | None, typer.Option(help="Also time frames of this size.", metavar="WxH")] = None,
    cards: Annotated[bool, typer.Option(
        "--cards", help="Also write the figures into the model card beside each network.")] = False,
    provider: Provider = "auto",
    out: Annotated[Path, typer.Option(help="Folder for validation.csv, .json and .md.",
                                      metavar="DIR")] = Path("out/validation"),
) -> None:
    """Compare models, and the best constant ambient light, on the validation views; prints means of each scene."""
    from app.bench.rows import to_csv
    from app.errors import SettingsError
    from app.evaluation.configurations import all_models
    from app.io.atomic_files import prepare_folders, write_text
    from app.settings import Settings, parse_size
    from export.validation.card_section import cards_of, write_figures
    from export.validation.errors import by_view, judge, to_json
    from export.validation.tables import HEADER, table, to_markdown
    from export.validation.timing import frame_times
    from export.validation.views import SCENES, views

    size = Settings(parse_size(time)).size if time is not None else None
    if cards and only:
        raise SettingsError("--cards needs all views", "--only", "expected either --cards or --only")
    names = models or all_models()
    written = cards_of(names) if cards else {}
    chosen = views(scenes or SCENES, only or ())
    if not chosen:
        raise SettingsError(f"no view of {', '.join(only or ())}", "--only", "expected scenes of the validation list")
    prepare_folders(out)
    rows = judge(chosen, names, spp, references, provider, say, oracle)
    times = frame_times(chosen, names, size, provider, say) if size is not None else None
    write_text(out / "validation.csv", to_csv(by_view(rows)))
    write_text(out / "validation.json", to_json(rows, {"spp": spp, "times": times and asdict(times)}))
    write_text(out / "validation.md", to_markdown(rows, times))
    write_figures(written, rows, spp, times)
    shown = Table(*HEADER, box=box.SIMPLE)
    for line in table(rows, times):
        shown.add_row(*line)
    print_table(shown)


@cli.command()
def paths(
    models: Models = None, references: References = None, scenes: Scenes = None,
    spp: Annotated[int | None, typer.Option(
        help="Paths per pixel of the references.", min=2, metavar="N",
        show_default=f"{SPP}, or {QUICK_SPP} with --quick")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer frames, small and noisy.")] = False,
    provider: Provider = "auto",
    out: Annotated[Path, typer.Option(help="Folder for camera_paths.json and a plot of each path.",
                                      metavar="DIR")] = Path("out/camera_paths"),
) -> None:
    """Compare models along camera paths: how steady their light is, and whether it stays when its source is off screen."""
    from app.evaluation.configurations import NONE, all_models
    from app.io.atomic_files import prepare_folders, write_text
    from export.validation.camera_paths import camera_paths
    from export.validation.path_errors import QUICK_SIZE, SIZE, judge_camera_paths, plot, to_json
    from export.validation.views import SCENES

    prepare_folders(out)
    chosen = models or [name for name in all_models() if name != NONE]
    size, spp = QUICK_SIZE if quick else SIZE, spp or (QUICK_SPP if quick else SPP)
    rows = judge_camera_paths(camera_paths(scenes or SCENES, quick), chosen, size, spp, references, provider, say)
    write_text(out / "camera_paths.json", to_json(rows, {"size": size, "spp": spp}))
    verdicts = {True: "yes", False: "no", None: "too noisy"}
    shown = Table("path", "model", "change", "of the reference's", "mean", "gradient", "luminance error", "passes",
                  box=box.SIMPLE)
    for row in rows:
        shown.add_row(row.walk, row.model, "" if row.error is None else f"{row.error:.2%}",
                      "" if row.error_ratio is None else f"{row.error_ratio:.2f}", f"{row.mean:.3f}",
                      "" if row.gradient is None else f"{row.gradient:.3f}", f"{row.max_luminance_error:.1%}",
                      verdicts[row.passes])
    print_table(shown)
    for name in dict.fromkeys(row.walk for row in rows):
        plot([row for row in rows if row.walk == name], out / f"{name}.png")


@cli.command()
def environments(
    models: Annotated[list[str] | None, typer.Argument(
        metavar="[MODEL]…", help="none, unshadowed_environment, names of bundled networks and paths.",
        show_default="none unshadowed_environment")] = None,
    references: References = None, scenes: Scenes = None,
    spp: Annotated[int, typer.Option(help="Samples per pixel of the references, which are denoised.", min=8)] = 256,
    out: Annotated[Path, typer.Option(help="Folder for environments.csv.",
                                      metavar="DIR")] = Path("out/environments"),
) -> None:
    """Compare the light that comes straight from an environment on open views; prints means of each scene."""
    from app.bench.rows import to_csv
    from app.evaluation.reference import cache_folder
    from app.io.atomic_files import prepare_folders, write_text
    from export.validation.environment_errors import METRICS, by_scene, environment_views, judge
    from export.validation.views import SCENES

    prepare_folders(out)
    rows = judge(environment_views(scenes or SCENES), models or ["none", "unshadowed_environment"], spp,
                 references or cache_folder() / "environments", say)
    write_text(out / "environments.csv", to_csv(rows))
    shown = Table("scene", "views", "model", *METRICS, box=box.SIMPLE)
    for row in by_scene(rows):
        shown.add_row(row["scene"], str(row["views"]), row["model"], *(f"{row[name]:.3f}" for name in METRICS))
    print_table(shown)


@cli.command()
def choose(
    scenes: Scenes = None, seed: int = 0,
    drop: Annotated[list[str] | None, typer.Option(help="Name of a view to leave out.", metavar="NAME")] = None,
    sheet: Annotated[Path | None, typer.Option(help="Contact sheet to write.", metavar="FILE.png")] = None,
) -> None:
    """Choose the validation views anew and write their list; with --sheet also a picture of every view to look at."""
    from export.validation.choose_views import write_views
    from export.validation.views import SCENES

    write_views(scenes or SCENES, seed, drop or [], sheet)
