"""``python -m export reference``: the path-traced reference of one image."""

from pathlib import Path
from typing import Annotated

import typer

from app.errors import SettingsError, did_you_mean
from app.io.atomic_files import prepare_folders
from app.io.terminal import transient_progress
from app.load import auto_camera, embedded_scene, lighting_of, load_scene
from app.load.cameras import AUTO
from app.scene import CameraPath
from app.settings import parse_size

MAX_SPP, MAX_SECONDS = 2**15, 1e6
SCENE = typer.Argument(metavar="[SCENE]", help="Scene file; by default the embedded Cornell box.")


def reference(scene: Annotated[Path | None, SCENE] = None,
              camera: Annotated[str | None, typer.Option(
                  help="auto, or a camera of the scene.", metavar="auto|NAME")] = None,
              lighting: Annotated[str | None, typer.Option(help="A lighting of the scene's JSON file.")] = None,
              scene_json: Annotated[Path | None, typer.Option(help="JSON file of cameras, lightings, motion.")] = None,
              studio: Annotated[bool | None, typer.Option(
                  "--studio/--no-studio", help="As for `python -m app render`.", show_default=False)] = None,
              ground: Annotated[bool, typer.Option("--ground", help="Add a ground below the scene.")] = False,
              animation: Annotated[str | None, typer.Option(help="An animation of the file, all, or none.")] = None,
              variant: Annotated[str | None, typer.Option(help="A variant of the file's materials.")] = None,
              time: Annotated[float, typer.Option(help="Seconds.", min=0, max=MAX_SECONDS)] = 0.0,
              size: Annotated[str, typer.Option(help="Width and height in pixels.", metavar="WxH")] = "256x192",
              spp: Annotated[int, typer.Option(help="Paths per pixel.", min=1)] = 256,
              max_bounces: Annotated[int, typer.Option(help="Of indirect light.", min=1, max=1000)] = 16,
              baselines: Annotated[str, typer.Option(
                  help="Write images at these paths per pixel, with timings, instead of the reference.",
                  metavar="N,…")] = "",
              denoise: Annotated[bool, typer.Option(
                  "--denoise", help="Denoise reflected and indirect light by Open Image Denoise.")] = False,
              seed: Annotated[int, typer.Option(min=0, max=31)] = 0,  # baselines derive 32-bit seeds from it
              out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("reference")) -> None:
    """Path-trace a scene: reference.exr with direct, indirect and final light, reference.json with its noise."""
    for option, given in (("--scene-json", scene_json), ("--animation", animation), ("--variant", variant),
                          ("--studio", studio or None), ("--ground", ground or None)):
        if scene is None and given is not None:
            raise SettingsError("needs a scene", option, "expected a SCENE too")
    if denoise and baselines:
        raise SettingsError("baselines are not denoised", "--denoise", "expected it without --baselines")
    pixels, counts = parse_size(size), _parse_counts(baselines) if baselines else []
    from app.evaluation.denoise import denoiser_version
    from export.reference.mitsuba_module import load_mitsuba

    load_mitsuba()  # fails here, before the scene is read, when something is missing
    if denoise:
        denoiser_version()  # so does this
    from export.reference.still import Still
    from export.reference.trace import write_baselines, write_reference

    loaded = embedded_scene(lighting=lighting) if scene is None else load_scene(
        scene, lighting=lighting_of(lighting, studio), scene_json=scene_json, variant=variant, animation=animation,
        studio=studio is not False, ground=ground)
    cameras = {AUTO: CameraPath.still(auto_camera(loaded)), **loaded.cameras} if camera == AUTO else loaded.cameras
    name = camera or loaded.default_camera
    if name not in cameras:
        raise SettingsError(f"unknown name {name!r}", "--camera", did_you_mean(name, (AUTO, *cameras)))
    still = Still(loaded, cameras[name].at(time), pixels, time)
    prepare_folders(out)
    if counts:
        write_baselines(out, still, counts, seed, max_bounces)
        return
    about = {"scene": str(scene or "embedded"), "camera": name, "lighting": loaded.lighting}
    print("the path tracer is compiled for the scene first, which takes a minute or more if there are many materials",
          flush=True)
    with transient_progress() as bar:
        task = bar.add_task("tracing", total=1.0)
        traced = write_reference(out, still, spp, seed, max_bounces, about,
                                 lambda share: bar.update(task, completed=share), denoise)
    for name, value in traced.noise.items():
        print(f"{name}: noise " + ("unknown" if value is None else f"{value:.2%} of the mean")
              + (" before it was denoised" if denoise and name != "direct" else ""))
    for notice in traced.notices:
        print(f"note: {notice}")


def _parse_counts(text: str) -> list[int]:
    """Whole numbers from 1 to ``MAX_SPP``, separated by commas.

    Raises
    ------
    SettingsError
        For anything else.
    """
    counts = [int(part) if part.strip().isdecimal() else 0 for part in text.split(",")]
    if min(counts) < 1 or max(counts) > MAX_SPP:
        raise SettingsError(f"bad samples per pixel {text!r}", "--baselines",
                            f"expected whole numbers from 1 to {MAX_SPP}, such as 1,2,4")
    return counts
