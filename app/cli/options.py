"""Option types that commands share, and the parsing of their texts."""

from collections.abc import Collection
from fractions import Fraction
from pathlib import Path
from typing import Annotated

import typer

from app.errors import SettingsError, did_you_mean
from app.network.selection import DEFAULT_MODEL
from app.scene import Camera, Scene

FORMATS = ("exr", "png")
AUTO = "auto"
MAX_SECONDS = 1e6
MIN_COMPARED_SIDE = 11  # SSIM's window
SCENE, NETWORK, REFERENCE = "Scene", "Network and device", "Reference"  # panels of the help

SceneFile = Annotated[Path | None, typer.Argument(
    help="OBJ, glTF, GLB or PLY file; the embedded Cornell box if omitted.", metavar="[SCENE]", show_default=False)]
Lighting = Annotated[str | None, typer.Option(
    help="A named lighting of the scene's JSON file.", metavar="NAME", show_default="the scene's own",
    rich_help_panel=SCENE)]
CameraName = Annotated[str | None, typer.Option(
    help="A named camera of the scene.", metavar="NAME", show_default="the scene's own", rich_help_panel=SCENE)]
Studio = Annotated[bool | None, typer.Option(
    "--studio/--no-studio", help="Light the scene by a neutral studio alone; or leave one without light dark.",
    show_default="in a studio if it has no light", rich_help_panel=SCENE)]
Ground = Annotated[bool, typer.Option("--ground", help="Add a ground below the scene.", rich_help_panel=SCENE)]
Animation = Annotated[str | None, typer.Option(
    help="An animation of the scene's file, all of them, or none.", metavar="NAME|all|none", show_default="the first",
    rich_help_panel=SCENE)]
Time = Annotated[float, typer.Option(
    help="Seconds; when the first frame is.", min=0, max=MAX_SECONDS, metavar="SECONDS", rich_help_panel=SCENE)]
SceneJson = Annotated[Path | None, typer.Option(
    "--scene-json", help="Cameras, lightings and motion.", metavar="FILE", show_default="same stem beside the scene",
    rich_help_panel=SCENE)]
Variant = Annotated[str | None, typer.Option(
    help="A variant of the materials of a glTF file.", metavar="NAME", show_default="the file's own",
    rich_help_panel=SCENE)]
ModelNames = Annotated[list[str], typer.Option(
    help="A name that `models` lists, a path to an .onnx file, or none. Repeat it for a model that shades an "
         "environment beside one for indirect light.", metavar="NAME|PATH|none", show_default=DEFAULT_MODEL,
    rich_help_panel=NETWORK)]
Bounces = Annotated[int | None, typer.Option(
    help="Bounces of indirect light: of models that take a number (ember, radiosity), and of single-bounce networks "
         "that read screen-space inputs only, which are applied repeatedly.", metavar="N",
    show_default="the model's own", rich_help_panel=NETWORK)]
Provider = Annotated[str, typer.Option(
    help="onnxruntime execution provider.", metavar="auto|cpu|cuda|…", rich_help_panel=NETWORK)]
Rays = Annotated[str, typer.Option(
    help="What traces rays: cpu, gpu where it can, or auto: the GPU if one draws.", metavar="auto|cpu|gpu",
    rich_help_panel=NETWORK)]
StrictDevice = Annotated[bool, typer.Option(
    "--strict-device", help="Refuse a software renderer, and any provider other than the one asked for.",
    rich_help_panel=NETWORK)]
Tonemap = Annotated[str, typer.Option(
    help="srgb (clamped), agx, pbr-neutral, aces, or a display and view of OpenColorIO.", metavar="NAME|DISPLAY/VIEW",
    rich_help_panel="Picture")]
AutoExposure = Annotated[bool, typer.Option(
    "--auto-exposure", help="Bring the mean luminance to middle grey, slowly over the frames of a video.",
    rich_help_panel="Picture")]
ReferenceFolder = Annotated[str, typer.Option(
    help="Folder with the reference, or auto: path-traced and cached. For several scenes, the folder contains one "
         "folder per scene.", metavar="DIR|auto", rich_help_panel=REFERENCE)]
SamplesPerPixel = Annotated[int, typer.Option(
    "--spp", help="Samples per pixel of a new reference.", min=8, metavar="N", rich_help_panel=REFERENCE)]


def parse_folder(text: str | Path) -> Path:
    """A folder's path, which must not be empty: that would be the current folder.

    Raises
    ------
    SettingsError
        When the text is empty or not UTF-8, which images can't be written to.
    """
    if not str(text).strip():
        raise SettingsError("no folder given", "--out", "expected a folder, such as out, or . for the current one")
    try:
        str(text).encode()
    except UnicodeEncodeError:
        raise SettingsError(f"can't write to {str(text)!r}", "--out", "expected a name in UTF-8") from None
    return Path(text)


def refuse_folder(path: Path, option: str, kind: str) -> None:
    """Check that ``path``, where a file of the given kind is to be written, is not a folder.

    Raises
    ------
    SettingsError
        When it is.
    """
    if path.is_dir():
        raise SettingsError(f"{path} is a folder", option, f"expected the name of a {kind} file")


def parse_list(text: str) -> list[str]:
    """The parts of ``text`` between commas, each once and in the given order."""
    return list(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))


def parse_names(text: str, known: Collection[str], option: str) -> tuple[str, ...]:
    """Known names separated by commas, each once and in the given order.

    Raises
    ------
    SettingsError
        When there is none, or one is not among ``known``.
    """
    names = parse_list(text)
    if not names:
        raise SettingsError("no name given", option, f"expected one or more of: {', '.join(known)}")
    for name in names:
        check_name(name, known, option)
    return tuple(names)


def check_name(name: str, known: Collection[str], option: str) -> None:
    """Check that ``name`` is one of the ``known`` ones.

    Raises
    ------
    SettingsError
        When it is not.
    """
    if name not in known:
        raise SettingsError(f"unknown name {name!r}", option, did_you_mean(name, known))


def parse_scale(text: str, option: str, least: float = 0.0) -> float:
    """A size relative to the image's, such as ``1/8`` or ``0.25``.

    Raises
    ------
    SettingsError
        When it is no number above 0, from ``least`` to 1.
    """
    try:
        scale = float(Fraction(text))
    except (ValueError, ZeroDivisionError):
        raise SettingsError(f"bad scale {text!r}", option, "expected a number, such as 1/8 or 0.25") from None
    if not (least <= scale <= 1 and scale > 0):
        bounds = f"from {least} to 1" if least else "above 0, at most 1"
        raise SettingsError(f"bad scale {text!r}", option, f"expected a number {bounds}")
    return scale


def named_camera(scene: Scene, name: str | None) -> Camera:
    """The scene's camera of that name, or its default camera for None, at the first frame.

    Raises
    ------
    SettingsError
        When the scene has no such camera.
    """
    if name is not None:
        check_name(name, scene.cameras, "--camera")
    return scene.cameras[name or scene.default_camera].at(0.0)
