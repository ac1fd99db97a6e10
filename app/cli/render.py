"""``python -m app [SCENE]``: draw frames and write them."""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.arrays import Bytes
from app.cli.options import (
    AUTO,
    FORMATS,
    NETWORK,
    SCENE,
    Animation,
    AutoExposure,
    Bounces,
    Ground,
    Lighting,
    ModelNames,
    Provider,
    Rays,
    SceneFile,
    SceneJson,
    StrictDevice,
    Studio,
    Time,
    Tonemap,
    Variant,
    parse_folder,
    parse_names,
    parse_scale,
    refuse_folder,
)
from app.cli.report import print_summary
from app.errors import SettingsError, did_you_mean
from app.io.aov_preview import preview
from app.io.atomic_files import check_folders, prepare_folders, write_text
from app.io.exr_header import picture_header
from app.io.image import exr_layer, write_exr, write_png
from app.io.terminal import note, transient_progress
from app.io.video import CODECS, check_video, open_video
from app.network.selection import DEFAULT_MODEL, NONE, environment_notices, find_model
from app.scene import CameraPath, Scene
from app.settings import MIN_RENDER_SCALE, SETTLE_FRAMES, TONE_MAPS, Settings, parse_size

if TYPE_CHECKING:
    from app.renderer import Renderer

FRAME_SECONDS = 1 / 30
PICTURE, DIAGNOSTICS = "Picture", "Diagnostics"  # panels of the help


def render(
    scene: SceneFile = None,
    camera: Annotated[str | None, typer.Option(
        help="auto, orbit (one turn over all frames), a camera of the scene, or a FILE.json.",
        metavar="auto|orbit|NAME|FILE.json", show_default="the scene's own", rich_help_panel=SCENE)] = None,
    lighting: Lighting = None,
    scene_json: SceneJson = None,
    studio: Studio = None,
    ground: Ground = False,
    variant: Variant = None,
    animation: Animation = None,
    time: Time = 0.0,
    out: Annotated[Path, typer.Option(
        help="Folder for the frames; created if missing.", metavar="DIR", parser=parse_folder,
        rich_help_panel=PICTURE)] = Path("out"),
    size: Annotated[str, typer.Option(
        help="Width and height in pixels.", metavar="WxH", rich_help_panel=PICTURE)] = "1024x768",
    frames: Annotated[int, typer.Option(
        help="Frames to write, 1/30 s apart.", min=1, metavar="N", rich_help_panel=PICTURE)] = 1,
    settle: Annotated[int | None, typer.Option(
        help="Frames drawn before the first one that is written, so that TAA converges.", min=0, metavar="N",
        show_default=f"{SETTLE_FRAMES} for a still, more with --render-scale, 0 otherwise",
        rich_help_panel=PICTURE)] = None,
    aov: Annotated[str, typer.Option(
        help="Images to write: final, albedo, normal, depth, position, motion, direct, specular, reflection, indirect, "
             "emission, …", metavar="NAME,…", rich_help_panel=PICTURE)] = "final",
    formats: Annotated[str, typer.Option(
        "--format", help="exr (linear, all AOVs), png (for display), and video of the PNGs: mp4, webm, gif.",
        metavar="exr,png,mp4,…", rich_help_panel=PICTURE)] = ",".join(FORMATS),
    exposure: Annotated[float, typer.Option(
        help="Linear factor for the PNG; the EXR is not affected.", metavar="FACTOR", rich_help_panel=PICTURE)] = 1.0,
    tonemap: Tonemap = TONE_MAPS[0],
    auto_exposure: AutoExposure = False,
    taa: Annotated[bool, typer.Option(
        "--taa/--no-taa", help="Temporal anti-aliasing.", rich_help_panel=PICTURE)] = True,
    reflections: Annotated[bool, typer.Option(
        "--reflections/--no-reflections", help="Indirect light on glossy surfaces.",
        rich_help_panel=PICTURE)] = True,
    render_scale: Annotated[str, typer.Option(
        help="Size at which frames are drawn before TAA accumulates them at full size, relative to it, from 0.5 to 1.",
        metavar="SCALE", rich_help_panel=PICTURE)] = "1",
    seed: Annotated[int, typer.Option(
        help="Varies the sampling patterns.", metavar="N", rich_help_panel=PICTURE)] = 0,
    model: ModelNames = [DEFAULT_MODEL],  # noqa: B006
    bounces: Bounces = None,
    scale: Annotated[str | None, typer.Option(
        help="Size of the networks' grids relative to the image, such as 1/8.", metavar="SCALE",
        show_default="their own", rich_help_panel=NETWORK)] = None,
    provider: Provider = AUTO,
    rays: Rays = AUTO,
    strict_device: StrictDevice = False,
    timing: Annotated[Path | None, typer.Option(
        help="Time each pass; write milliseconds (median, p95), the device and what was culled.", metavar="FILE.json",
        show_default=False, rich_help_panel=DIAGNOSTICS)] = None,
    check: Annotated[bool, typer.Option(
        "--check", help="Count non-finite texels per pass.", rich_help_panel=DIAGNOSTICS)] = False,
    verbose: Annotated[bool, typer.Option(
        "--verbose", "-v", help="Print the renderer, provider and passes, and what was culled and why.",
        rich_help_panel=DIAGNOSTICS)] = False,
) -> None:
    """Render frames of a scene as EXR, PNG and video.

    Lengths are in the scene's own units, radiance in W/(sr m²), times in milliseconds.

    [bold]Examples[/bold]

    [cyan]python -m app[/cyan]  [dim]# the embedded Cornell box[/dim]

    [cyan]python -m app sponza.glb --lighting sun --timing timing.json[/cyan]  [dim]# and its time per pass[/dim]

    [cyan]python -m app room.obj --camera orbit --frames 60 --format mp4[/cyan]  [dim]# one turn in two seconds[/dim]

    [cyan]python -m app room.obj --aov final,normal,depth --format exr[/cyan]  [dim]# one EXR with three layers[/dim]

    [cyan]python -m app room.obj --model mine.onnx --provider cuda --strict-device[/cyan]  [dim]# your own network[/dim]
    """
    # Heavy imports wait until there is something to render, so that help stays quick.
    from app.frame import AOVS
    from app.load import embedded_scene, lighting_of, load_scene
    from app.renderer import Renderer

    settings = Settings(
        size=parse_size(size), render_scale=parse_scale(render_scale, "--render-scale", MIN_RENDER_SCALE),
        outputs=parse_names(aov, AOVS, "--aov"), taa=taa, reflections=reflections,
        exposure=exposure, tonemap=tonemap, auto_exposure=auto_exposure, bounces=bounces, seed=seed, provider=provider,
        rays=rays, strict_device=strict_device, timing=timing is not None, check=check,
        scale=None if scale is None else parse_scale(scale, "--scale"))
    if provider != AUTO:
        from app.network.providers import check_provider  # imports onnxruntime

        check_provider(provider)
    kinds = parse_names(formats, (*FORMATS, *CODECS), "--format")
    check_video([kind for kind in kinds if kind in CODECS], settings.size)
    if timing is not None:
        refuse_folder(timing, "--timing", "JSON")
    if tonemap not in TONE_MAPS:
        from app.io.color_management import find_view  # imports OpenColorIO

        find_view(tonemap)
    folders = out, *([timing.parent] if timing is not None else [])
    check_folders(*folders)
    models = [find_model(name) for name in model if name != NONE]
    if scale is not None and not any(isinstance(m, Path) for m in models):
        raise SettingsError("needs a network", "--scale", "expected a --model that is one")
    if scene is not None:
        loaded = load_scene(scene, lighting=lighting_of(lighting, studio), scene_json=scene_json, variant=variant,
                            animation=animation, studio=studio is not False, ground=ground)
    elif scene_json is None and animation is None and variant is None and not (studio or ground):
        loaded = embedded_scene(lighting=lighting)
    else:
        options = {"--scene-json": scene_json, "--animation": animation, "--variant": variant,
                   "--studio": studio or None, "--ground": ground or None}
        option = next(name for name, value in options.items() if value is not None)
        raise SettingsError("needs a scene", option, "expected a SCENE too")
    path = choose_camera(loaded, camera, frames, time)
    for notice in loaded.notices:
        note(notice)
    with Renderer(loaded, settings, models) as renderer:
        for name in renderer.missing:
            note(f"{name} is all zero, nothing in this scene writes it")
        for notice in environment_notices(loaded, models):
            note(notice)
        if verbose:
            _describe(renderer)
            for approximation in loaded.approximations:
                typer.echo(f"approximated {approximation}", err=True)
        prepare_folders(*folders)
        if settle is None:
            has_taa = "taa" in renderer.plan.resources
            settle = settings.settle_frames if frames == 1 and has_taa else 0
        images = _draw(renderer, path, settings, time, frames, settle, out, kinds)
        report = {
            **renderer.timing(), "culled": dict(renderer.plan.culled), "device": renderer.device,
            "model": "+".join(Path(m).stem for m in models) or None, "size": list(settings.size), "scene": loaded.name,
            "triangles": loaded.triangles, "frames": frames,
        }
    if timing is not None:
        write_text(timing, json.dumps(report, indent=2) + "\n")
    print_summary(report, images, timing, check=check)


def choose_camera(scene: Scene, name: str | None, frames: int | None = None, start: float = 0.0) -> CameraPath:
    """The camera for the text of ``--camera``: of the scene, of a file, automatic or orbiting from ``start`` on.

    Parameters
    ----------
    frames : int or None
        That an orbit has; None where there is none.

    Raises
    ------
    SettingsError
        When the scene has no camera of that name.
    """
    from app.load import auto_camera, load_camera, orbit
    from app.load.cameras import CAMERA_FILE, ORBIT

    name = scene.default_camera if name is None else name
    if name in scene.cameras:
        return scene.cameras[name]
    if name == AUTO:
        return CameraPath.still(auto_camera(scene))
    if name == ORBIT and frames is not None:
        keys = orbit(scene, scene.cameras[scene.default_camera].at(start), frames)
        return CameraPath(tuple(start + index * FRAME_SECONDS for index in range(frames)), tuple(keys))
    if name.endswith(CAMERA_FILE):
        return load_camera(Path(name))
    words = (AUTO,) if frames is None else (AUTO, ORBIT)
    known = dict.fromkeys((*words, *scene.cameras))
    raise SettingsError(f"unknown name {name!r}", "--camera", did_you_mean(name, known))


def _draw(renderer: Renderer, path: CameraPath, settings: Settings, start: float, frames: int, settle: int, out: Path,
          kinds: tuple[str, ...]) -> list[Path]:
    """Draw the settling frames, then draw and write the others from ``start`` on; returns the files written."""
    total = settle + frames
    files = [out / f"video.{kind}" for kind in kinds if kind in CODECS]
    stills = tuple(kind for kind in kinds if kind not in CODECS)
    names = () if "exr" in kinds else (_shown(settings),)  # reading all outputs back takes long
    with ExitStack() as stack:
        videos = [stack.enter_context(open_video(file, settings.size)) for file in files]
        bar = stack.enter_context(transient_progress(disable=total == 1))
        task = bar.add_task("rendering", total=total)
        for _ in range(settle):
            renderer.advance(path.at(start), start)
            bar.advance(task)
        for index in range(frames):
            time = start + index * FRAME_SECONDS
            following = time + FRAME_SECONDS
            images = renderer.render(path.at(time), time, (path.at(following), following), names)
            header = picture_header(renderer.scene, path.at(time), settings.size, settings.outputs)
            files += _write(images, settings, out / f"{index:04d}", stills, header)
            for write in videos:
                write(_display_image(images, settings))
            bar.advance(task)
    return files


def _write(images: dict[str, Any], settings: Settings, stem: Path, kinds: tuple[str, ...],
           header: dict[str, str]) -> list[Path]:
    files = [stem.with_suffix(f".{kind}") for kind in kinds]
    for file in files:
        if file.suffix == ".exr":
            write_exr(file, {"" if n == "final" else n: exr_layer(n, images[n]) for n in settings.outputs},
                      header=header)
        else:
            write_png(file, _display_image(images, settings))
    return files


def _display_image(images: dict[str, Any], settings: Settings) -> Bytes:
    """The image of a PNG or video frame."""
    name = _shown(settings)
    return images[name] if name == "display" else preview(name, images[name], settings.exposure)


def _shown(settings: Settings) -> str:
    """What a PNG or a video shows: the final picture as displayed, or the first AOV if there is none."""
    return "display" if "final" in settings.outputs else settings.outputs[0]


def _describe(renderer: Renderer) -> None:
    lines = {
        "GL renderer": renderer.device["gl_renderer"], "OpenGL": renderer.device["gl_version"],
        "provider": renderer.device["provider"], "rays": renderer.device["rays"],
        "passes": ", ".join(p.name for p in renderer.plan.passes),
        "shadows": ", ".join(f"{count} {name}" for name, count in renderer.shadow_methods.items()) or "none",
        **{f"culled {name}": why for name, why in renderer.plan.culled.items()},
    }
    for label, text in lines.items():
        typer.echo(f"{label}: {text}", err=True)
