"""``python -m export``: write the bundled networks, put a contract into somebody else's, trace the truth, or try half
precision.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress

from app.atomic import prepare_folders, write_text
from app.contract import ModelContract
from app.errors import AfterglowError, ModelError, SettingsError
from app.load import embedded_scene, load_scene
from app.paths import nets_dir
from app.settings import Settings, parse_size
from export.mitsuba_scene import mitsuba
from export.to_onnx import MODULES, export_network
from export.to_onnx import stamp as stamp_file

cli = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__)


@cli.command()
def onnx(names: Annotated[list[str] | None, typer.Argument(help="Networks to export; all without any.")] = None,
         out: Annotated[Path | None, typer.Option(help="Folder to write to; nets/ by default.")] = None) -> None:
    """Export networks with their contracts, checked against torch."""
    for name in _known(names):
        print(export_network(name, out or nets_dir()))


@cli.command()
def stamp(model: Annotated[Path, typer.Argument(help="An .onnx file; it is rewritten.")],
          contract: Annotated[Path, typer.Argument(help="JSON file with the contract.")]) -> None:
    """Put a contract into an .onnx file."""
    try:
        text = contract.read_text()
    except OSError as error:
        raise ModelError(f"can't read the contract ({error.strerror})", contract, "expected a JSON file") from None
    stamp_file(model, ModelContract.from_json(text, contract))


@cli.command()
def precision(names: Annotated[list[str] | None, typer.Argument(help="Networks; all without any.")] = None,
              scene: Annotated[list[Path] | None, typer.Option(
                  help="Scene files to take real inputs from; the bundled scenes without any.")] = None,
              json: Annotated[Path | None, typer.Option(help="Write the rows as JSON too.", metavar="FILE")] = None,
              ) -> None:
    """Print a table of what half precision changes in networks, and where it overflows."""
    from export.precision import as_json, as_markdown, default_scenes, table

    rows = table(_known(names), {path.stem: load_scene(path) for path in scene} if scene else default_scenes())
    if json is not None:
        write_text(json, as_json(rows))
    print(as_markdown(rows))


def _known(names: list[str] | None) -> list[str]:
    for name in names or ():
        if name not in MODULES:
            raise ModelError(f"no network {name!r}", "python -m export", f"expected one of {', '.join(MODULES)}")
    return names or list(MODULES)


MOST_PLAIN = 2**15
SCENE = typer.Argument(metavar="[SCENE]", help="Scene file; the embedded Cornell box without it.")


@cli.command()
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
    """Path-trace a scene: truth.exr with direct, indirect and final light, aovs.exr with the renderer's images."""
    mitsuba()  # says what is missing, if anything is
    from export.reference import Still, write_plain, write_reference

    loaded = embedded_scene(lighting=lighting) if scene is None else load_scene(scene, lighting=lighting,
                                                                                scene_json=scene_json)
    if camera is not None and camera not in loaded.cameras:
        raise SettingsError(f"no camera {camera!r}", "--camera", f"expected one of {', '.join(loaded.cameras)}")
    still = Still(loaded, loaded.cameras[camera or loaded.default_camera].at(0.0), Settings(parse_size(size)).size)
    prepare_folders(out)
    if plain:
        write_plain(out, still, _counts(plain), seed, max_bounces)
        return
    about = {"scene": str(scene or "embedded"), "camera": camera or loaded.default_camera, "lighting": loaded.lighting}
    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("tracing", total=1.0)
        found = write_reference(out, still, spp, seed, max_bounces, about,
                                lambda share: bar.update(task, completed=share))
    for name, value in found.noise.items():
        print(f"{name}: noise " + ("unknown" if value is None else f"{value:.2%} of the mean"))
    for notice in found.notices:
        print(f"note: {notice}")


def _counts(text: str) -> list[int]:
    counts = [int(part) if part.strip().isdecimal() else 0 for part in text.split(",")]
    if min(counts) < 1 or max(counts) > MOST_PLAIN:
        raise SettingsError(f"bad numbers of paths {text!r}", "--plain",
                            f"expected whole numbers up to {MOST_PLAIN}, such as 1,2,4")
    return counts


if __name__ == "__main__":
    try:
        cli()
    except AfterglowError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
