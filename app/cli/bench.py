"""``python -m app bench``: speed against error."""

from __future__ import annotations

import json
import shlex
import sys
import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from app.cli.options import parse_folder, parse_names, parse_scale
from app.errors import SettingsError
from app.settings import Settings, parse_size

WORSE = 1
ALL, AUTO = "all", "auto"
MIN_SIDE = 11
EMBEDDED = "cornell-box.obj", "patio.obj"  # a closed scene, and one under a sky

COLUMNS = {"size": "size", "frame.median_ms": "ms", "frame.p95_ms": "p95", "final.flip": "FLIP", "final.psnr": "PSNR",
           "startup_s": "start s", "peak_mb": "MB"}
WHAT, REFERENCE, OUTPUT = "What is measured", "Reference", "Output"


def bench(
    scenes: Annotated[list[Path] | None, typer.Argument(
        metavar="SCENE", help="Scene files; the embedded Cornell box and patio without any.",
        show_default=False)] = None,
    models: Annotated[str, typer.Option(
        help="all (none, ssgi, the bundled networks, and under an environment ember with each that shades it), or "
             "names and paths; NAME+NAME draws with one that makes indirect light and one that shades an environment.",
        metavar="all|NAME,…",
        rich_help_panel=WHAT)] = ALL,
    sizes: Annotated[str, typer.Option(
        help="Pixels; errors are judged at the first size.", metavar="WxH,…",
        rich_help_panel=WHAT)] = "256x192,1024x768",
    scales: Annotated[str, typer.Option(
        help="Networks' grids relative to the image, such as 1/8,1/4.", metavar="SCALE,…", show_default="their own",
        rich_help_panel=WHAT)] = "",
    precision: Annotated[str, typer.Option(
        help="float32, float16: networks, or their variants NAME-half.onnx. What half precision changes in numbers: "
             "python -m export precision.", metavar="TYPE,…",
        show_default="their own", rich_help_panel=WHAT)] = "",
    lighting: Annotated[str | None, typer.Option(
        help="A named lighting that all scenes have; without scenes, those of the embedded ones that have it.",
        metavar="NAME", show_default="each scene's own",
        rich_help_panel=WHAT)] = None,
    camera: Annotated[str | None, typer.Option(
        help="A named camera that all scenes have; without scenes, those of the embedded ones that have it.",
        metavar="NAME", show_default="each scene's own",
        rich_help_panel=WHAT)] = None,
    provider: Annotated[str, typer.Option(
        help="onnxruntime execution provider.", metavar="auto|cpu|cuda|…", rich_help_panel=WHAT)] = AUTO,
    repeats: Annotated[int, typer.Option(
        help="Turns that each configuration takes.", min=1, metavar="N", rich_help_panel=WHAT)] = 5,
    grow: Annotated[bool, typer.Option(
        "--grow", help="Also sweep pixels, triangles, lights, queries, surfels and width in a generated scene.",
        rich_help_panel=WHAT)] = False,
    reference: Annotated[str, typer.Option(
        help="Folder with the reference (of more than one scene: with a folder for each scene's name), or auto: "
             "path-traced and kept.",
        metavar="DIR|auto", rich_help_panel=REFERENCE)] = AUTO,
    spp: Annotated[int, typer.Option(
        help="Samples per pixel of a reference that is made.", min=8, metavar="N", rich_help_panel=REFERENCE)] = 1024,
    out: Annotated[Path, typer.Option(
        help="Folder for bench.json, bench.csv, pareto.svg and report.html.", metavar="DIR",
        parser=parse_folder, rich_help_panel=OUTPUT)] = Path("out/bench"),
    compare: Annotated[Path | None, typer.Option(
        help="Result of an earlier run; exit code 1 when something became slower or worse beyond noise.",
        metavar="OLD.json", show_default=False, rich_help_panel=OUTPUT)] = None,
) -> None:
    """Measure time and error of every model against the path-traced reference, beside what one would use instead.

    Writes JSON, CSV and one HTML page with the speed-error scatter, the stages' times, pictures and FLIP maps.
    Needs the extra [bold]judge[/bold], and [bold]export[/bold] for the reference and the path tracer.

    [bold]Examples[/bold]

    [cyan]python -m app bench sponza.glb room.obj[/cyan]  [dim]# all models, reference made and kept[/dim]

    [cyan]python -m app bench room.obj --models none,mine.onnx --scales 1/16,1/8[/cyan]  [dim]# your own network[/dim]

    [cyan]python -m app bench yard.obj --models none,ember,ember+coarse[/cyan]  [dim]# light of the sky[/dim]

    [cyan]python -m app bench room.obj --sizes 256x192,1024x768 --spp 512[/cyan]  [dim]# as for the page in docs/[/dim]

    [cyan]python -m app bench room.obj --compare bench/bench.json[/cyan]  [dim]# what did a change cost?[/dim]
    """
    from app.bench.regressions import read_results
    from app.bench.run import Options
    from app.bench.run import bench as measure
    from app.bench.scaling import grow as measure_growth
    from app.evaluation.configurations import PRECISIONS, all_models, expand, sky_models
    from app.io.atomic_files import prepare_folders
    from app.network.session import check_provider

    check_provider(provider)
    old = None if compare is None else read_results(compare)
    options = Options(
        scenes=tuple(scenes or embedded(lighting, camera)), sizes=_sizes(sizes), lighting=lighting, camera=camera,
        reference_folder=None if reference == AUTO else Path(reference), spp=spp, turns=repeats,
        provider=provider)
    names = (*all_models(), *sky_models()) if models == ALL else tuple(_list(models))
    if not names:
        raise SettingsError("no model given", "--models", "expected all, or names and paths")
    precisions = parse_names(precision, PRECISIONS, "--precision") if precision else ()
    with tempfile.TemporaryDirectory() as folder:
        grids = [parse_scale(part, "--scales") for part in _list(scales)]
        configurations, absent = expand(names, options.sizes, grids, precisions, Path(folder))
        if not configurations:
            raise SettingsError("; ".join(absent), "--precision", "expected a model that exists in that precision")
        prepare_folders(out)
        outcome = measure(options, configurations, _say)
        outcome.results |= {"command": _command(), "absent": [*absent, *outcome.results["absent"]]}
        if grow:
            outcome.results["growth"] = measure_growth(configurations, repeats, provider, Path(folder), _say)
    _write(out, outcome)
    _print(outcome.results)
    typer.echo(f"wrote {out}/report.html, bench.json, bench.csv and pareto.svg")
    if old is not None and _print_changes(old, outcome.results):
        raise typer.Exit(WORSE)


def embedded(lighting: str | None, camera: str | None) -> list[Path]:
    """The embedded scenes that have the lighting and the camera, where such are named.

    Raises
    ------
    SettingsError
        When none has.
    """
    from app.load.sidecar import read_sidecar
    from app.paths import data_dir

    found = {data_dir() / name: read_sidecar((data_dir() / name).with_suffix(".json")) for name in EMBEDDED}
    for option, name, kind in (("--lighting", lighting, "lightings"), ("--camera", camera, "cameras")):
        known = {file: getattr(sidecar, kind) for file, sidecar in found.items()}
        if name is not None:
            found = {file: sidecar for file, sidecar in found.items() if name in known[file]}
        if not found:
            names = dict.fromkeys(key for some in known.values() for key in some)
            raise SettingsError(f"no embedded scene has {name!r}", option, f"expected one of {', '.join(names)}")
    return list(found)


def _write(out: Path, outcome: Any) -> None:
    from app.bench.plots import scatter
    from app.bench.report import html_report
    from app.bench.rows import rows, to_csv
    from app.io.atomic_files import write_text

    # The figures first: they took long.
    write_text(out / "bench.json", json.dumps(outcome.results, indent=1, allow_nan=False) + "\n")
    write_text(out / "bench.csv", to_csv(rows(outcome.results)))
    write_text(out / "pareto.svg", scatter(outcome.results))
    write_text(out / "report.html", html_report(outcome.results, outcome.pictures))


def _print(results: dict[str, Any]) -> None:
    """The renderer's own rows; those of its baselines are in the files."""
    from app.bench.rows import number, rows

    console = Console(highlight=False)
    for scene in results["scenes"]:
        table = Table(scene["name"], *COLUMNS.values(), box=box.SIMPLE)
        for row in rows({**results, "scenes": [{**scene, "baselines": []}]}):
            cells = [row.get(key) for key in COLUMNS]
            table.add_row(str(row["label"]), *(number(c) if isinstance(c, float) else str(c or "") for c in cells))
        console.print(table)
    for row in results["headlines"]:
        speed, error = (f"{row[key]['bound']}{number(row[key]['value'])}" for key in ("speed_up", "error_ratio"))
        console.print(f"{row['model']} against {row['against']}: speed-up at equal error {speed}, error ratio at equal "
                      f"time {error}", soft_wrap=True, markup=False)
    notices = [f"{scene['name']}: {notice}" for scene in results["scenes"] for notice in scene["reference"]["notices"]]
    for line in [*results["absent"], *notices]:
        console.print(f"note: {line}", soft_wrap=True, markup=False)


def _print_changes(old: dict[str, Any], new: dict[str, Any]) -> bool:
    """Print what changed beyond noise; whether something became slower or worse."""
    from app.bench.regressions import compare

    changes, notes = compare(old, new)
    for line in [f"note: {note}" for note in notes] + [str(change) for change in changes]:
        typer.echo(line)
    if not changes:
        typer.echo("nothing changed beyond noise")
    return any(change.worse for change in changes)


def _sizes(text: str) -> tuple[tuple[int, int], ...]:
    found = tuple(dict.fromkeys(Settings(size=parse_size(part)).size for part in _list(text)))
    if not found:
        raise SettingsError("no size given", "--sizes", "expected such as 256x192,1024x768")
    if min(map(min, found)) < MIN_SIDE:
        raise SettingsError(f"bad sizes {text!r}", "--sizes", f"expected sides of at least {MIN_SIDE}, SSIM's window")
    return found


def _list(text: str) -> list[str]:
    return list(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))


def _command() -> str:
    return shlex.join(["python", "-m", "app", *sys.argv[1:]])


def _say(line: str) -> None:
    typer.secho(line, err=True, dim=True)
