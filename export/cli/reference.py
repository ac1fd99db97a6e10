"""``python -m export reference``: the path-traced truth of one picture."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress

from app.atomic import prepare_folders
from app.errors import SettingsError
from app.load import embedded_scene, load_scene
from app.settings import Settings, parse_size
from export.cli.options import parse_counts

SCENE = typer.Argument(metavar="[SCENE]", help="Scene file; the embedded Cornell box without it.")


def reference(scene: Annotated[Path | None, SCENE] = None,
              camera: Annotated[str | None, typer.Option(help="A camera of the scene.")] = None,
              lighting: Annotated[str | None, typer.Option(help="A lighting of the scene's JSON file.")] = None,
              scene_json: Annotated[Path | None, typer.Option(help="Cameras, lightings and motion.")] = None,
              size: Annotated[str, typer.Option(help="Width and height in pixels.", metavar="WxH")] = "256x192",
              spp: Annotated[int, typer.Option(help="Paths per pixel.", min=1)] = 256,
              max_bounces: Annotated[int, typer.Option(help="Of indirect light.", min=1)] = 16,
              plain: Annotated[str, typer.Option(help="Instead: pictures at these paths per pixel, with their times.",
                                                 metavar="N,…")] = "",
              seed: Annotated[int, typer.Option(min=0)] = 0,
              out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("reference")) -> None:
    """Path-trace a scene: truth.exr with direct, indirect and final light, aovs.exr with the renderer's images."""
    from export.mitsuba_scene import mitsuba

    mitsuba()  # says what is missing, if anything is
    from export.reference import Still, write_plain, write_reference

    loaded = embedded_scene(lighting=lighting) if scene is None else load_scene(scene, lighting=lighting,
                                                                                scene_json=scene_json)
    if camera is not None and camera not in loaded.cameras:
        raise SettingsError(f"no camera {camera!r}", "--camera", f"expected one of {', '.join(loaded.cameras)}")
    still = Still(loaded, loaded.cameras[camera or loaded.default_camera].at(0.0), Settings(parse_size(size)).size)
    prepare_folders(out)
    if plain:
        write_plain(out, still, parse_counts(plain, "--plain"), seed, max_bounces)
        return
    about = {"scene": str(scene or "embedded"), "camera": camera or loaded.default_camera, "lighting": loaded.lighting}
    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("tracing", total=1.0)
        noise = write_reference(out, still, spp, seed, max_bounces, about,
                                lambda share: bar.update(task, completed=share))
    for name, value in noise.items():
        print(f"{name}: noise {value:.2%} of the mean")
