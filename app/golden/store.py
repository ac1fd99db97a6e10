"""A folder of goldens: ``CASE/RESOURCE.exr`` in half floats, with a layer ``frameN`` for each frame.

``CASE/origin.json`` names what drew the case's goldens.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import quote

from app.errors import OutputError, SceneError
from app.golden.case import F32, Picture, half
from app.io.atomic_files import write_text
from app.io.image import read_exr, write_exr

ORIGIN = "origin.json"
LAYER = "frame"


def file_name(resource: str) -> str:
    """The file of a resource's golden; a network may give its tensors names with slashes."""
    return f"{quote(resource, safe='')}.exr"


def write_case(folder: Path, origin: str, pictures: Iterable[Picture]) -> None:
    """Make the new folder of one case."""
    folder.mkdir()
    for p in pictures:
        write_exr(folder / file_name(p.resource), {f"{LAYER}{n}": half(image) for n, image in p.frames.items()})
    write_text(folder / ORIGIN, json.dumps({"renderer": origin}, indent=2) + "\n")


def read_picture(folder: Path, resource: str) -> dict[int, F32] | None:
    """The golden of a resource by frame; None where there is none.

    Raises
    ------
    SceneError
        When the file can't be read, or its layers are no frames.
    """
    path = folder / file_name(resource)
    if not path.exists():
        return None
    layers = read_exr(path)
    for layer in layers:
        if not layer.removeprefix(LAYER).isdecimal():
            raise SceneError(f"a layer {layer!r} in a golden", path, f"expected {LAYER}1, {LAYER}2, …")
    return {int(layer.removeprefix(LAYER)): image for layer, image in layers.items()}


def read_origin(folder: Path) -> str | None:
    """What drew a case's goldens; None where it isn't said.

    Raises
    ------
    SceneError
        When the file can't be read, or names nothing.
    """
    path = folder / ORIGIN
    try:
        origin = json.loads(path.read_text("utf-8"))["renderer"]
        if not isinstance(origin, str) or not origin.strip():
            raise ValueError("no name of a renderer")
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise SceneError(f"can't read the origin of the goldens ({error})", path, 'expected {"renderer": "NAME"}; '
                         "delete the case's folder, and golden update makes it anew") from None
    return origin


def names(folder: Path) -> list[str]:
    """Everything in a folder, sorted; nothing where it is none."""
    return sorted(file.name for file in folder.iterdir()) if folder.is_dir() else []


def refuse_strangers(folder: Path) -> None:
    """Make sure that nothing but goldens lies in ``folder``, since an update replaces it.

    Goldens are the EXR files beside an ``origin.json``.

    Raises
    ------
    OutputError
        With the first other thing.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputError("this is no folder", folder, "expected a folder of goldens, or a new one")
    for case in names(folder):
        strangers = [f"{case}/{file}" for file in names(folder / case)
                     if file != ORIGIN and not (file.endswith(".exr") and (folder / case / file).is_file())]
        if not (folder / case / ORIGIN).is_file():
            strangers.insert(0, case)
        if strangers:
            raise OutputError(f"{strangers[0]} is no golden image", folder,
                              "expected a folder of goldens alone, or a new one")
