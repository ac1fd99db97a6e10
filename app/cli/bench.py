"""``python -m app bench``: time against error."""

import json
import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from app.cli.options import (
    AUTO,
    MIN_COMPARED_SIDE,
    NETWORK,
    CameraName,
    Lighting,
    Provider,
    ReferenceFolder,
    SamplesPerPixel,
    Variant,
    parse_folder,
    parse_list,
    parse_names,
    parse_scale,
)
from app.errors import SettingsError, did_you_mean
from app.io.terminal import print_table, say
from app.network.selection import DEFAULT_MODEL
from app.paths import PROGRAM
from app.settings import MIN_RENDER_SCALE, parse_size

WORSE = 1  # exit code
ALL = "all"
EMBEDDED = "cornell-box.obj", "patio.obj"  # a closed scene, and one with an environment

COLUMNS = {"size": "size", "frame.median_ms": "ms", "frame.p95_ms": "p95", "final.flip": "FLIP", "final.psnr": "PSNR",
           "startup_s": "start s", "peak_mb": "MB"}
OUTPUT = "Output"


def bench(
    scenes: Annotated[list[Path] | None, typer.Argument(
        metavar="SCENE", help="Scene files; the embedded Cornell box and patio if omitted.",
        show_default=False)] = None,
    models: Annotated[str, typer.Option(
        help="all (none, ssgi, the bundled networks, ember at half the size, and under an environment ember with each "
             "that shades it), or names and paths; NAME+NAME for one for indirect light and one that shades an "
             "environment; NAME@SCALE for frames drawn at a fraction of the size (--render-scale of the renderer).",
        metavar="all|NAME,…", rich_help_panel=NETWORK)] = ALL,
    sizes: Annotated[str, typer.Option(
        help="Pixels; errors are measured at the first size.", metavar="WxH,…")] = "256x192,1024x768",
    scales: Annotated[str, typer.Option(
        help="Sizes of the networks' grids relative to the image, such as 1/8,1/4.", metavar="SCALE,…",
        show_default="their own", rich_help_panel=NETWORK)] = "",
    precision: Annotated[str, typer.Option(
        help="float32, float16 (the variant NAME-half.onnx). See also python -m export onnx precision.",
        metavar="TYPE,…", show_default="their own", rich_help_panel=NETWORK)] = "",
    lighting: Lighting = None,
    camera: CameraName = None,
    variant: Variant = None,
    provider: Provider = AUTO,
    repeats: Annotated[int, typer.Option(
        help="Rounds in which each configuration is timed.", min=1, metavar="N")] = 5,
    scaling: Annotated[bool, typer.Option(
        "--scaling", help="Also sweep pixels, triangles, lights, queries, surfels and width in a generated scene.",
    )] = False,
    reference: ReferenceFolder = AUTO,
    spp: SamplesPerPixel = 1024,
    out: Annotated[Path, typer.Option(
        help="Folder for bench.json, bench.csv, pareto.svg and report.html.", metavar="DIR",
        parser=parse_folder, rich_help_panel=OUTPUT)] = Path("out/bench"),
    compare: Annotated[Path | None, typer.Option(
        help="Result of an earlier run; exit code 1 if something became significantly slower or worse.",
        metavar="OLD.json", show_default=False, rich_help_panel=OUTPUT)] = None,
) -> None:
    """Measure time and error of every model against the path-traced reference, and of path-traced baselines.

    Writes JSON, CSV and one HTML page with time-error plots, the passes' times, pictures and FLIP maps. The embedded
    scenes are measured if they have the named lighting and camera. Needs the extra [bold]evaluation[/bold], and
    [bold]export[/bold] for the reference and the baselines.

    [bold]Examples[/bold]

    [cyan]python -m app bench sponza.glb room.obj[/cyan]  [dim]# all models, reference path-traced and cached[/dim]

    [cyan]python -m app bench room.obj --models none,mine.onnx --scales 1/16,1/8[/cyan]  [dim]# your own network[/dim]

    [cyan]python -m app bench yard.obj --models none,ember,ember+ndr-8[/cyan]  [dim]# light of the sky[/dim]

    [cyan]python -m app bench room.obj --sizes 256x192,1024x768 --spp 512[/cyan]  [dim]# as for the page in docs/[/dim]

    [cyan]python -m app bench room.obj --compare bench/bench.json[/cyan]  [dim]# the cost of a change[/dim]
    """
    from app.bench.regressions import read_results
    from app.bench.run import Options
    from app.bench.run import bench as measure
    from app.bench.scaling import measure_scaling
    from app.evaluation.configurations import PRECISIONS, expand
    from app.io.atomic_files import prepare_folders
    from app.network.providers import check_provider
    from app.network.selection import all_models, sky_models

    check_provider(provider)
    old = None if compare is None else read_results(compare)
    options = Options(
        scenes=tuple(scenes or embedded(lighting, camera)), sizes=_sizes(sizes), lighting=lighting, camera=camera,
        variant=variant, reference_folder=None if reference == AUTO else Path(reference), spp=spp, rounds=repeats,
        provider=provider, skip_idle_scenes=not scenes)
    every = (*all_models(), f"{DEFAULT_MODEL}@{MIN_RENDER_SCALE}", *sky_models())
    names = every if models == ALL else tuple(parse_list(models))
    if not names:
        raise SettingsError("no model given", "--models", "expected all, or names and paths")
    precisions = parse_names(precision, PRECISIONS, "--precision") if precision else ()
    grids = [parse_scale(part, "--scales") for part in parse_list(scales)]
    configurations, absent = expand(names, options.sizes, grids, precisions)
    if not configurations:
        raise SettingsError("; ".join(absent), "--precision", "expected a model that exists in that precision")
    prepare_folders(out)
    outcome = measure(options, configurations, say)
    command = shlex.join(["python", "-m", PROGRAM, *sys.argv[1:]])
    outcome.results |= {"command": command, "absent": [*absent, *outcome.results["absent"]]}
    if scaling:
        outcome.results["scaling"] = measure_scaling(configurations, repeats, provider, say)
    _write(out, outcome)
    _print(outcome.results)
    typer.echo(f"wrote {out}/report.html, bench.json, bench.csv and pareto.svg")
    if old is not None and _print_changes(old, outcome.results):
        raise typer.Exit(WORSE)


def embedded(lighting: str | None, camera: str | None) -> list[Path]:
    """The embedded scenes that have the lighting and the camera, if they are named.

    Raises
    ------
    SettingsError
        When none has.
    """
    from app.load.sidecar import read_sidecar
    from app.paths import data_dir

    sidecars = {data_dir() / name: read_sidecar((data_dir() / name).with_suffix(".json")) for name in EMBEDDED}
    for option, name, kind in (("--lighting", lighting, "lightings"), ("--camera", camera, "cameras")):
        if name is None:
            continue
        known = {file: getattr(sidecar, kind) for file, sidecar in sidecars.items()}
        sidecars = {file: sidecar for file, sidecar in sidecars.items() if name in known[file]}
        if not sidecars:
            names = dict.fromkeys(key for keys in known.values() for key in keys)
            raise SettingsError(f"no embedded scene has {name!r}", option, did_you_mean(name, names))
    return list(sidecars)


def _write(out: Path, outcome: Any) -> None:
    from app.bench.plots import plot_errors
    from app.bench.records import rows
    from app.bench.report import html_report
    from app.evaluation.tables import to_csv
    from app.io.atomic_files import write_text

    # The measurements first, since they took long.
    write_text(out / "bench.json", json.dumps(outcome.results, indent=1, allow_nan=False) + "\n")
    write_text(out / "bench.csv", to_csv(rows(outcome.results)))
    write_text(out / "pareto.svg", plot_errors(outcome.results))
    write_text(out / "report.html", html_report(outcome.results, outcome.pictures))


def _print(results: dict[str, Any]) -> None:
    """Print the configurations' rows; those of the baselines are in the files."""
    from app.bench.records import rows
    from app.evaluation.tables import format_number

    console = Console(highlight=False)
    for scene in results["scenes"]:
        table = Table(scene["name"], *COLUMNS.values(), box=box.SIMPLE)
        for row in rows({**results, "scenes": [{**scene, "baselines": []}]}):
            values = [row.get(key) for key in COLUMNS]
            cells = (format_number(v) if isinstance(v, float) else str(v or "") for v in values)
            table.add_row(str(row["label"]), *cells)
        print_table(table)
    for row in results["headlines"]:
        speed, error = (f"{row[key]['bound']}{format_number(row[key]['value'])}" for key in ("speed_up", "error_ratio"))
        console.print(f"{row['model']} against {row['against']}: speed-up at equal error {speed}, error ratio at equal "
                      f"time {error}", soft_wrap=True, markup=False)
    notices = [f"{scene['name']}: {notice}" for scene in results["scenes"] for notice in scene["reference"]["notices"]]
    for line in [*results["absent"], *notices]:
        console.print(f"note: {line}", soft_wrap=True, markup=False)


def _print_changes(old: dict[str, Any], new: dict[str, Any]) -> bool:
    """Print significant changes and return whether something became slower or worse."""
    from app.bench.regressions import compare

    changes, notes = compare(old, new)
    for line in [f"note: {note}" for note in notes] + [str(change) for change in changes]:
        typer.echo(line)
    if not changes:
        typer.echo("no significant change")
    return any(change.worse for change in changes)


def _sizes(text: str) -> tuple[tuple[int, int], ...]:
    sizes = tuple(dict.fromkeys(parse_size(part, "--sizes") for part in parse_list(text)))
    if not sizes:
        raise SettingsError("no size given", "--sizes", "expected sizes, such as 256x192,1024x768")
    if min(map(min, sizes)) < MIN_COMPARED_SIDE:
        raise SettingsError(f"bad sizes {text!r}", "--sizes",
                            f"expected sides of at least {MIN_COMPARED_SIDE}, SSIM's window")
    return sizes
