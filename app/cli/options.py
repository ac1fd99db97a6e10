"""Options that commands share, and texts of the command line into values."""

from __future__ import annotations

import difflib
from collections.abc import Collection
from fractions import Fraction
from pathlib import Path
from typing import Annotated

import typer

from app.errors import SettingsError

FORMATS = ("exr", "png")
DEFAULT_MODEL = "ember"
SCENE, NETWORK = "Scene", "Network and device"  # panels of the help

SceneFile = Annotated[Path | None, typer.Argument(
    help="OBJ, glTF, GLB or PLY file; the embedded Cornell box without it.", metavar="[SCENE]", show_default=False)]
Lighting = Annotated[str | None, typer.Option(
    help="A named lighting of the scene's JSON file.", metavar="NAME", show_default="the scene's own",
    rich_help_panel=SCENE)]
SceneJson = Annotated[Path | None, typer.Option(
    "--scene-json", help="Cameras, lightings and motion.", metavar="FILE", show_default="same stem beside the scene",
    rich_help_panel=SCENE)]
ModelNames = Annotated[list[str], typer.Option(
    help="A name that `models` lists, a path to an .onnx file, or none; twice for one that makes indirect light "
         "and one that shades an environment.", metavar="NAME|PATH|none", show_default=DEFAULT_MODEL,
    rich_help_panel=NETWORK)]
Bounces = Annotated[int | None, typer.Option(
    help="Bounces of indirect light, of models that count them (ember, radiosity) and of networks of one bounce "
         "that see the screen alone, which are applied again.", metavar="N", show_default="what the model gives",
    rich_help_panel=NETWORK)]
Provider = Annotated[str, typer.Option(
    help="onnxruntime execution provider.", metavar="auto|cpu|cuda|…", rich_help_panel=NETWORK)]
StrictDevice = Annotated[bool, typer.Option(
    "--strict-device", help="Refuse a software renderer, or a provider other than the one asked for.",
    rich_help_panel=NETWORK)]


def parse_folder(text: str | Path) -> Path:
    """A folder that was named; without a name it would be the current one.

    Raises
    ------
    SettingsError
        When the text is empty.
    """
    if not str(text).strip():
        raise SettingsError("no name given", "--out", "expected a folder, such as out, or . for the current one")
    return Path(text)


def parse_names(text: str, known: Collection[str], option: str) -> tuple[str, ...]:
    """Names separated by commas, each once and in the given order.

    Raises
    ------
    SettingsError
        When there is none, or one is not among ``known``.
    """
    names = tuple(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))
    if not names:
        raise SettingsError("no name given", option, f"expected one or more of {', '.join(known)}")
    for name in names:
        if name not in known:
            raise unknown(name, known, option)
    return names


def parse_scale(text: str, option: str) -> float:
    """A network's grid relative to the image, such as ``1/8`` or ``0.25``.

    Raises
    ------
    SettingsError
        When it is no number above 0 and at most 1.
    """
    try:
        scale = float(Fraction(text))
    except (ValueError, ZeroDivisionError):
        raise SettingsError(f"bad scale {text!r}", option, "expected such as 1/8 or 0.25") from None
    if not 0 < scale <= 1:
        raise SettingsError(f"bad scale {text!r}", option, "expected a number above 0, at most 1")
    return scale


def unknown(name: str, known: Collection[str], option: str) -> SettingsError:
    """Error for a name that is not ``known``, with the nearest one that is."""
    near = difflib.get_close_matches(name, known, 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return SettingsError(f"unknown name {name!r}", option, f"{hint}expected one of {', '.join(known)}")
