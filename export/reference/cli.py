"""``python -m export reference``: the path-traced reference of one picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.errors import SettingsError
from app.io.atomic_files import prepare_folders
from app.io.terminal import transient_progress
from app.load import embedded_scene, load_scene
from app.settings import Settings, parse_size

MAX_COUNT = 2**15  # samples per pixel
SCENE = typer.Argument(metavar="[SCENE]", help="Scene file; the embedded Cornell box without it.")


def reference(scene: Annotated[Path | None, SCENE] = None,
              camera: Annotated[str | None, typer.Option(help="A camera of the scene.")] = None,
              lighting: Annotated[str | None, typer.Option(help="A lighting of the scene's JSON file.")] = None,
              scene_json: Annotated[Path | None, typer.Option(help="Cameras, lightings and motion.")] = None,
              size: Annotated[str, typer.Option(help="Width and height in pixels.", metavar="WxH")] = "256x192",
              spp: Annotated[int, typer.Option(help="Paths per pixel.", min=1)] = 256,
              max_bounces: Annotated[int, typer.Option(help="Of indirect light.", min=1, max=1000)] = 16,
              plain: Annotated[str, typer.Option(help="Instead: pictures at these paths per pixel, with their times.",
                                                 metavar="N,…")] = "",
              seed: Annotated[int, typer.Option(min=0, max=31)] = 0,  # with --plain it fills a sampler's 32 bits
              out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("reference")) -> None:
    """Path-trace a scene: reference.exr with direct, indirect and final light, aovs.exr with the renderer's images."""
    from export.reference.mitsuba_scene import mitsuba

    mitsuba()  # says what is missing, if anything is
    from export.reference.still import Still
    from export.reference.trace import write_plain, write_reference

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
    with transient_progress() as bar:
        task = bar.add_task("tracing", total=1.0)
        found = write_reference(out, still, spp, seed, max_bounces, about,
                                lambda share: bar.update(task, completed=share))
    for name, value in found.noise.items():
        print(f"{name}: noise " + ("unknown" if value is None else f"{value:.2%} of the mean"))
    for notice in found.notices:
        print(f"note: {notice}")


def parse_counts(text: str, option: str) -> list[int]:
    """Whole numbers from 1 to ``MAX_COUNT``, separated by commas.

    Raises
    ------
    SettingsError
        When one is not.
    """
    counts = [int(part) if part.strip().isdecimal() else 0 for part in text.split(",")]
    if min(counts) < 1 or max(counts) > MAX_COUNT:
        raise SettingsError(f"bad numbers of paths {text!r}", option,
                            f"expected whole numbers up to {MAX_COUNT}, such as 1,2,4")
    return counts
