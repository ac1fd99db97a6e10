"""``python -m app compare``: models beside each other and the reference, on one page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.errors import SettingsError
from app.io.atomic_files import prepare_folders, write_text
from app.settings import Settings, parse_size

if TYPE_CHECKING:
    from app.evaluation.reference import Reference
    from app.scene import Camera, Scene

AUTO = "auto"
MIN_SIDE = 11  # SSIM's window


def compare(
    scene: Annotated[Path | None, typer.Argument(
        help="OBJ, glTF, GLB or PLY file; the embedded Cornell box without it.", metavar="[SCENE]",
        show_default=False)] = None,
    models: Annotated[str, typer.Option(
        help="Names and paths as for --model, NAME+NAME for one that makes indirect light and one that shades an "
             "environment, and reference. What the others are compared with is the reference, or else the last one.",
        metavar="NAME,…")] = "none,radiosity,ember,reference",
    size: Annotated[str, typer.Option(help="Width and height in pixels.", metavar="WxH")] = "512x384",
    camera: Annotated[str | None, typer.Option(
        help="A camera of the scene.", metavar="NAME", show_default="the scene's own")] = None,
    lighting: Annotated[str | None, typer.Option(
        help="A named lighting of the scene's JSON file.", metavar="NAME", show_default="the scene's own")] = None,
    reference: Annotated[str, typer.Option(
        help="Folder with the reference, or auto: path-traced and kept.", metavar="DIR|auto")] = AUTO,
    spp: Annotated[int, typer.Option(help="Samples per pixel of a reference that is made.", min=8, metavar="N")] = 256,
    provider: Annotated[str, typer.Option(
        help="onnxruntime execution provider.", metavar="auto|cpu|cuda|…")] = "auto",
    out: Annotated[Path, typer.Option(help="The page.", metavar="FILE.html")] = Path("out/compare.html"),
) -> None:
    """Compare models on one page: sliders between any two, FLIP maps and numbers, in a single file.

    Needs the extra [bold]judge[/bold], and for the reference [bold]export[/bold].

    [bold]Examples[/bold]

    [cyan]python -m app compare[/cyan]  [dim]# the embedded Cornell box against the path tracer[/dim]

    [cyan]python -m app compare room.glb --models ssgi,mine.onnx,reference[/cyan]  [dim]# your own network[/dim]

    [cyan]python -m app compare yard.obj --models ember,ember+coarse,reference[/cyan]  [dim]# two draw together[/dim]
    """
    from app.bench.comparison_page import REFERENCE, side_by_side
    from app.bench.run import JUDGE
    from app.evaluation.configurations import at_work, expand, nothing_to_shade
    from app.extras import extra_module
    from app.load import load_scene
    from app.network.session import check_provider
    from app.paths import data_dir

    names = list(dict.fromkeys(part.strip() for part in models.split(",") if part.strip()))
    drawn = [name for name in names if name != REFERENCE]
    pixels = Settings(size=parse_size(size)).size
    configurations, _ = expand(drawn, [pixels])
    if not drawn or len(configurations) + (REFERENCE in names) < 2:
        raise SettingsError(f"nothing to compare in {models!r}", "--models", "expected two or more, such as none,reference")
    if min(pixels) < MIN_SIDE:
        raise SettingsError(f"bad size {size!r}", "--size", f"expected sides of at least {MIN_SIDE}, SSIM's window")
    if out.is_dir():
        raise SettingsError(f"{out} is a folder", "--out", "expected the name of an HTML file")
    check_provider(provider)
    for name in JUDGE:  # says at once what is missing
        extra_module(name, "judge")
    file = scene or data_dir() / "cornell-box.obj"
    loaded = load_scene(file, lighting=lighting)
    if idle := at_work(configurations, loaded)[1]:
        raise nothing_to_shade(loaded, idle)
    if camera is not None and camera not in loaded.cameras:
        raise SettingsError(f"no camera {camera!r}", "--camera", f"expected one of {', '.join(loaded.cameras)}")
    seen = loaded.cameras[camera or loaded.default_camera].at(0.0)
    prepare_folders(out.parent)
    traced = None
    if REFERENCE in names:
        _say("reference")
        traced = _load_reference(reference, file, lighting, camera, loaded, seen, pixels, spp)
    write_text(out, side_by_side(loaded, seen, configurations, traced, provider, _say))
    typer.echo(f"wrote {out}")


def _load_reference(reference: str, file: Path, lighting: str | None, camera: str | None, scene: Scene, seen: Camera,
           size: tuple[int, int], spp: int) -> Reference:
    from app.evaluation.reference import Order, make_reference, read_reference

    if reference == AUTO:
        return make_reference(Order(file, lighting, camera, size), scene, seen, spp)
    traced = read_reference(Path(reference))
    if traced.size != size:
        raise SettingsError(f"the reference is {traced.size[0]}x{traced.size[1]}", reference, "expected the size of --size")
    return traced


def _say(line: str) -> None:
    typer.secho(line, err=True, dim=True)
