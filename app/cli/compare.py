"""``python -m app compare``: models side by side with each other and the reference, on one page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.options import (
    AUTO,
    MIN_COMPARED_SIDE,
    CameraName,
    Lighting,
    Provider,
    ReferenceFolder,
    SamplesPerPixel,
    SceneFile,
    Variant,
    named_camera,
    parse_list,
    refuse_folder,
)
from app.errors import SettingsError
from app.io.atomic_files import prepare_folders, write_text
from app.io.terminal import say
from app.network.selection import DEFAULT_COMPARISON
from app.settings import parse_size

if TYPE_CHECKING:
    from app.evaluation.reference import Reference, TraceRequest
    from app.scene import Camera, Scene


def compare(
    scene: SceneFile = None,
    models: Annotated[str, typer.Option(
        help="Names and paths as for --model, NAME+NAME for one for indirect light and one that shades an environment, "
             "and reference. The others are compared with the reference, or without it with the last one.",
        metavar="NAME,…")] = ",".join((*DEFAULT_COMPARISON, "reference")),
    size: Annotated[str, typer.Option(help="Width and height in pixels.", metavar="WxH")] = "512x384",
    camera: CameraName = None,
    lighting: Lighting = None,
    variant: Variant = None,
    reference: ReferenceFolder = AUTO,
    spp: SamplesPerPixel = 256,
    provider: Provider = AUTO,
    out: Annotated[Path, typer.Option(help="The page.", metavar="FILE.html")] = Path("out/compare.html"),
) -> None:
    """Compare models on one page: sliders between any two, FLIP maps and errors, in a single file.

    Needs the extra [bold]evaluation[/bold], and for the reference [bold]export[/bold].

    [bold]Examples[/bold]

    [cyan]python -m app compare[/cyan]  [dim]# the embedded Cornell box against the path tracer[/dim]

    [cyan]python -m app compare room.glb --models ssgi,mine.onnx,reference[/cyan]  [dim]# your own network[/dim]

    [cyan]python -m app compare yard.obj --models ember,ember+ndr-8,reference[/cyan]  [dim]# two models at once[/dim]
    """
    # Heavy imports wait until there is something to compare, so that help stays quick.
    from app.evaluation.comparison_page import REFERENCE, make_comparison_page
    from app.evaluation.configurations import expand, no_environment_error, select_applicable
    from app.evaluation.reference import TraceRequest
    from app.extras import require_evaluation_packages
    from app.load import load_scene
    from app.network.providers import check_provider
    from app.paths import data_dir

    names = parse_list(models)
    drawn = [name for name in names if name != REFERENCE]
    pixels = parse_size(size)
    configurations, _ = expand(drawn, [pixels])
    if not drawn or len(configurations) + (REFERENCE in names) < 2:
        raise SettingsError(f"nothing to compare in {models!r}", "--models",
                            "expected two or more, such as none,reference")
    if min(pixels) < MIN_COMPARED_SIDE:
        raise SettingsError(f"bad size {size!r}", "--size",
                            f"expected sides of at least {MIN_COMPARED_SIDE}, SSIM's window")
    refuse_folder(out, "--out", "HTML")
    check_provider(provider)
    require_evaluation_packages()
    file = scene or data_dir() / "cornell-box.obj"
    loaded = load_scene(file, lighting=lighting, variant=variant)
    if skipped := select_applicable(configurations, loaded)[1]:
        raise no_environment_error(loaded, skipped)
    view = named_camera(loaded, camera)
    prepare_folders(out.parent)
    traced = None
    if REFERENCE in names:
        say("reference")
        traced = _load_reference(reference, TraceRequest(file, lighting, camera, pixels, variant), loaded, view, spp)
    write_text(out, make_comparison_page(loaded, view, configurations, traced, provider, say))
    typer.echo(f"wrote {out}")


def _load_reference(reference: str, request: TraceRequest, scene: Scene, view: Camera, spp: int) -> Reference:
    from app.evaluation.reference import make_reference, read_reference

    if reference == AUTO:
        return make_reference(request, scene, view, spp)
    traced = read_reference(Path(reference))
    if traced.size != request.size:
        raise SettingsError(f"the reference is {traced.size[0]}x{traced.size[1]}", reference,
                            "expected the size of --size")
    return traced
