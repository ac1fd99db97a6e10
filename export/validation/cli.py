"""``python -m export validate``: compares models with references on views, along paths and on glossy surfaces."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from app.errors import SettingsError
from app.evaluation.tables import to_csv
from app.io.atomic_files import prepare_folders, write_text
from app.io.terminal import print_table, say

SPP, QUICK_SPP = 256, 16  # samples per pixel along camera paths
SCENES = Path("../shared/scenes")

# Each command imports what it runs, so that the others and --help start quickly.
cli = typer.Typer(no_args_is_help=True, help="Compare models with path-traced references on held-out views.")

Models = Annotated[list[str] | None, typer.Argument(
    metavar="[MODEL]…", help="none, ssgi, names of bundled networks and paths.", show_default="all")]
References = Annotated[Path | None, typer.Option(
    "--references", help="Folder that caches the path-traced references.", metavar="DIR",
    show_default="the benchmark's cache")]
Scenes = Annotated[Path, typer.Option(help="Folder of the scene files.", metavar="DIR")]
Provider = Annotated[str, typer.Option(help="onnxruntime execution provider.", metavar="auto|cpu|cuda|…")]


@cli.command(name="views")
def compare_on_views(
    models: Models = None, references: References = None, scenes: Scenes = SCENES,
    only: Annotated[list[str] | None, typer.Option(help="Views of these scenes only.", metavar="SCENE")] = None,
    lighting: Annotated[list[str] | None, typer.Option(
        help="Views of these lightings only, such as emissive.", metavar="LIGHTING")] = None,
    spp: Annotated[int, typer.Option(help="Paths per pixel of the references, which are denoised.", min=8)] = 128,
    oracle: Annotated[bool, typer.Option(
        "--oracle", help="Also compare each model with its light scaled to fit each view best.")] = False,
    time: Annotated[str | None, typer.Option(help="Also time frames of this size.", metavar="WxH")] = None,
    cards: Annotated[bool, typer.Option(
        "--cards", help="Also write the figures into the networks' model cards.")] = False,
    provider: Provider = "auto",
    out: Annotated[Path, typer.Option(help="Folder for validation.csv, .json and .md.",
                                      metavar="DIR")] = Path("out/validation"),
) -> None:
    """Compare models and the best constant ambient light on the validation views; print means per scene."""
    from app.evaluation.tables import markdown_table
    from app.network.selection import all_models
    from app.settings import parse_size
    from export.validation.errors import by_scene, measure_errors
    from export.validation.tables import HEADER, NOISE_HEADER, cards_of, noise_lines, table_lines, write_figures
    from export.validation.timing import frame_times
    from export.validation.views import views

    size = parse_size(time, "--time") if time is not None else None
    for option, names in (("--only", only), ("--lighting", lighting)):
        if cards and names:
            raise SettingsError("can't be combined with --cards, which needs all views", option, "expected one of them")
    labels = models or all_models()
    cards_to_write = cards_of(labels) if cards else {}
    chosen = views(scenes, only or (), lighting or ())
    if not chosen:
        raise SettingsError(f"no views of {', '.join([*(only or ()), *(lighting or ())])}", "--only and --lighting",
                            "expected scenes and lightings of the validation list")
    prepare_folders(out)
    rows = measure_errors(chosen, labels, spp, references, provider, say, oracle)
    times = frame_times(chosen, labels, size, provider, say) if size is not None else None
    results = {"spp": spp, "times": times and asdict(times), "scenes": by_scene(rows), "views": rows}
    lines = table_lines(rows, times)
    write_text(out / "validation.csv", to_csv(rows))
    write_text(out / "validation.json", json.dumps(results, indent=1) + "\n")
    noise = noise_lines(rows)
    write_text(out / "validation.md", f"{markdown_table(HEADER, lines)}\n\n{markdown_table(NOISE_HEADER, noise)}\n")
    write_figures(cards_to_write, rows, spp, times)
    _print(HEADER, lines)
    _print(NOISE_HEADER, noise)


@cli.command()
def paths(
    models: Models = None, references: References = None, scenes: Scenes = SCENES,
    spp: Annotated[int | None, typer.Option(
        help="Paths per pixel of the references.", min=2, metavar="N",
        show_default=f"{SPP}, or {QUICK_SPP} with --quick")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Draw fewer, smaller frames with noisier references.")] = False,
    provider: Provider = "auto",
    out: Annotated[Path, typer.Option(help="Folder for camera_paths.json and a plot of each path.",
                                      metavar="DIR")] = Path("out/camera_paths"),
) -> None:
    """Compare models along camera paths: is light steady, and does it stay when its source leaves the picture?"""
    from app.network.selection import NONE, all_models
    from export.validation.camera_paths import camera_paths
    from export.validation.path_errors import QUICK_SIZE, SIZE, compare_on_paths, plot

    prepare_folders(out)
    chosen = models or [name for name in all_models() if name != NONE]
    size, spp = QUICK_SIZE if quick else SIZE, spp or (QUICK_SPP if quick else SPP)
    rows = compare_on_paths(camera_paths(scenes, quick), chosen, size, spp, references, provider, say)
    results = {"size": size, "spp": spp, "rows": [{**asdict(row), "passes": row.passes} for row in rows]}
    write_text(out / "camera_paths.json", json.dumps(results, indent=1) + "\n")
    passes = {True: "yes", False: "no", None: "too noisy"}
    _print(("path", "model", "temporal error", "of the reference's", "mean", "gradient", "luminance error", "passes"),
           [(row.path, row.model, "" if row.error is None else f"{row.error:.2%}",
             "" if row.error_ratio is None else f"{row.error_ratio:.2f}", f"{row.mean:.3f}",
             "" if row.gradient is None else f"{row.gradient:.3f}", f"{row.max_luminance_error:.1%}",
             passes[row.passes]) for row in rows])
    for name in dict.fromkeys(row.path for row in rows):
        plot([row for row in rows if row.path == name], out / f"{name}.png")


@cli.command()
def environments(
    models: Annotated[list[str] | None, typer.Argument(
        metavar="[MODEL]…", help="none, unshadowed_environment, names of bundled networks and paths.",
        show_default="none unshadowed_environment")] = None,
    references: References = None, scenes: Scenes = SCENES,
    spp: Annotated[int, typer.Option(help="Samples per pixel of the references, which are denoised.", min=8)] = 256,
    out: Annotated[Path, typer.Option(help="Folder for environments.csv.",
                                      metavar="DIR")] = Path("out/environments"),
) -> None:
    """Compare the light that comes straight from an environment on open views; print means per scene."""
    from app.evaluation.reference import cache_folder
    from export.validation.environment_errors import METRICS, environment_views, measure_errors
    from export.validation.errors import by_scene

    prepare_folders(out)
    rows = measure_errors(environment_views(scenes), models or ["none", "unshadowed_environment"], spp,
                          references or cache_folder() / "environments", say)
    write_text(out / "environments.csv", to_csv(rows))
    _print(("scene", "views", "model", *METRICS),
           [(row["scene"], str(row["views"]), row["model"], *(f"{row[name]:.3f}" for name in METRICS))
            for row in by_scene(rows, METRICS)])


@cli.command()
def assets(
    folder: Annotated[Path, typer.Argument(help="Folder of glTF files, searched with its folders.", metavar="[DIR]")
                      ] = Path("../shared/assets"),
    only: Annotated[list[str] | None, typer.Option(help="Stem of a file.", metavar="NAME")] = None,
    size: Annotated[str, typer.Option(help="Width and height in pixels.", metavar="WxH")] = "384x288",
    spp: Annotated[int, typer.Option(help="Paths per pixel of the references.", min=8)] = 64,
    out: Annotated[Path, typer.Option(help="Folder for assets.csv and side-by-side pictures.",
                                      metavar="DIR")] = Path("out/assets"),
) -> None:
    """Compare direct light on assets under a point and a spot light, and those of glass in a studio; print decibels.

    Assets that assets.csv has already, at this size and with these paths, are not measured again.
    """
    from app.evaluation.tables import format_number
    from app.settings import parse_size
    from export.validation.assets import COLUMNS, Row, compare_assets, find_assets, mean_of

    files = find_assets(folder, only or ())
    if not files:
        raise SettingsError("no glTF files", folder, "expected a folder of .glb and .gltf files")
    prepare_folders(out)
    rows = compare_assets(files, parse_size(size), spp, out, say)
    shown: list[Row] = [*rows, {"asset": "mean", **{name: mean_of(rows, name) for name in COLUMNS}}]
    _print(("asset", *COLUMNS, ""),
           [(str(row["asset"]), *("" if row.get(name) is None else format_number(float(str(row[name])))
                                  for name in COLUMNS), str(row.get("error", ""))) for row in shown])


@cli.command()
def glossy(
    model: Annotated[str, typer.Argument(help="A bundled network, a path, or none.", metavar="[MODEL]")] = "ember",
    references: References = None, scenes: Scenes = SCENES,
    assets: Annotated[Path, typer.Option(help="Folder of the assets.", metavar="DIR")] = Path("../shared/assets"),
    only: Annotated[list[str] | None, typer.Option(help="Name of a view.", metavar="NAME")] = None,
    spp: Annotated[int, typer.Option(help="Paths per pixel of the references, which are denoised.", min=16)] = 256,
    provider: Provider = "auto",
    out: Annotated[Path, typer.Option(help="Folder for glossy.csv and side-by-side pictures.",
                                      metavar="DIR")] = Path("out/glossy"),
) -> None:
    """Compare the final picture on views of glossy surfaces, and the mean of spheres of each roughness."""
    from app.network.selection import find_models
    from export.validation.glossy import ERRORS, glossy_views, means_of, measure_errors, ratio_name
    from export.validation.scenes.glossy import ROUGHNESSES

    prepare_folders(out)
    models = find_models(model, "MODEL")
    rows = measure_errors(glossy_views(scenes, assets, only or ()), models, spp, references, provider, out, say)
    if not rows:
        raise SettingsError("no view can be drawn", "--only", "expected names of views whose files are there")
    columns = ("own", *ERRORS)
    ratios = [ratio_name(roughness) for roughness in ROUGHNESSES]
    write_text(out / "glossy.csv", to_csv([{**dict.fromkeys(("view", "variant", *columns, *ratios)), **row}
                                           for row in rows]))
    _print(("view", "variant", "reference's own psnr", *ERRORS),
           [(row["view"], row["variant"], *(f"{row[name]:.3f}" if name in row else "" for name in columns))
            for row in [*rows, *means_of(rows)]])
    _print(("mean over the reference's, by roughness", "variant", *(f"{r:g}" for r in ROUGHNESSES)),
           [(row["view"], row["variant"], *(f"{row[name]:.3f}" for name in ratios))
            for row in rows if ratios[0] in row])


@cli.command()
def detail(
    models: Models = None, references: References = None, scenes: Scenes = SCENES,
    only: Annotated[list[str] | None, typer.Option(help="Name of a view.", metavar="NAME")] = None,
    spp: Annotated[int, typer.Option(help="Paths per pixel of the references, which are denoised.", min=16)] = 64,
    provider: Provider = "auto",
    out: Annotated[Path, typer.Option(help="Folder for detail.csv and pictures.",
                                      metavar="DIR")] = Path("out/detail"),
) -> None:
    """Compare indirect light at 1024x768, where light changes within a coarse texel and at edges."""
    from app.errors import did_you_mean
    from export.validation.detail import ERRORS, means_of, measure_errors
    from export.validation.detail_views import NAMES, detail_views

    for name in only or ():
        if name not in NAMES:
            raise SettingsError(f"no view {name!r}", "--only", did_you_mean(name, NAMES))
    prepare_folders(out)
    rows = measure_errors(detail_views(scenes, only or ()), models or ["ember", "final-gather"], spp, references,
                          provider, out, say)
    columns = ("view", "kept aside", "model", *ERRORS)
    write_text(out / "detail.csv", to_csv([{**dict.fromkeys(columns), **row} for row in rows]))
    _print(("view", "model", *ERRORS),
           [(row["view"], row["model"], *(format(row[key], digits) if key in row else ""
                                          for key, digits in ERRORS.items())) for row in [*rows, *means_of(rows)]])


@cli.command()
def choose(
    scenes: Scenes = SCENES, seed: int = 0,
    drop: Annotated[list[str] | None, typer.Option(help="Name of a view to leave out.", metavar="NAME")] = None,
    sheet: Annotated[Path | None, typer.Option(help="Contact sheet to write.", metavar="FILE.png")] = None,
) -> None:
    """Choose the validation views and rewrite their list; --sheet also writes a contact sheet of all views."""
    from export.validation.choose_views import write_views

    write_views(scenes, seed, drop or [], sheet)


def _print(header: Sequence[str], lines: Iterable[Sequence[str]]) -> None:
    table = Table(*header, box=box.SIMPLE)
    for line in lines:
        table.add_row(*line)
    print_table(table)
