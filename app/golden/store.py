"""A folder of goldens: ``CASE/RESOURCE.exr`` in half floats, with a layer ``frameN`` for each frame.

``CASE/origin.json`` names the renderer that drew them.
"""

import json
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import quote

from app.arrays import F32
from app.errors import OutputError, SceneError
from app.golden.case import Picture, half
from app.io.atomic_files import write_text
from app.io.image import read_exr, write_exr

ORIGIN = "origin.json"
LAYER = "frame"


def file_name(resource: str) -> str:
    """The file of a resource's golden; names of a network's tensors may contain slashes."""
    return f"{quote(resource, safe='')}.exr"


def write_case(folder: Path, origin: str, pictures: Iterable[Picture]) -> None:
    """Write the goldens of one case to a new folder."""
    folder.mkdir()
    for p in pictures:
        write_exr(folder / file_name(p.resource), {f"{LAYER}{n}": half(image) for n, image in p.frames.items()})
    write_text(folder / ORIGIN, json.dumps({"renderer": origin}, indent=2) + "\n")


def read_picture(folder: Path, resource: str) -> dict[int, F32] | None:
    """The golden of a resource by frame number; None if there is none.

    Raises
    ------
    SceneError
        When the file can't be read, or a layer is not a frame.
    """
    path = folder / file_name(resource)
    if not path.exists():
        return None
    layers = read_exr(path)
    for layer in layers:
        if not layer.removeprefix(LAYER).isdecimal():
            raise SceneError(f"unknown layer {layer!r}", path, f"expected {LAYER}1, {LAYER}2, …")
    return {int(layer.removeprefix(LAYER)): image for layer, image in layers.items()}


def read_origin(folder: Path) -> str | None:
    """The origin of a case's goldens; None if there are none.

    Raises
    ------
    SceneError
        When the file can't be read, or contains no name.
    """
    path = folder / ORIGIN
    try:
        origin = json.loads(path.read_text("utf-8"))["renderer"]
        if not isinstance(origin, str) or not origin.strip():
            raise ValueError("it names no renderer")
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise SceneError(f"can't read the origin of the goldens: {error}", path, 'expected {"renderer": "NAME"}; '
                         "delete the case's folder and golden update draws it again") from None
    return origin


def names(folder: Path) -> list[str]:
    """Names of all entries of a folder, sorted; none if it is not a folder."""
    return sorted(file.name for file in folder.iterdir()) if folder.is_dir() else []


def check_replaceable(folder: Path) -> None:
    """Check that ``folder`` contains goldens only, since an update replaces it.

    Goldens are EXR files beside an ``origin.json``.

    Raises
    ------
    OutputError
        Names the first other entry.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputError("not a folder", folder, "expected a folder of goldens or a new one")
    for case in names(folder):
        others = [f"{case}/{file}" for file in names(folder / case)
                     if file != ORIGIN and not (file.endswith(".exr") and (folder / case / file).is_file())]
        if not (folder / case / ORIGIN).is_file():
            others.insert(0, case)
        if others:
            raise OutputError(f"{others[0]} is not a golden image", folder,
                              "expected a folder of goldens only, or a new one")
