"""The scenes of the validation list, which no network may be trained on."""

import hashlib
import json
from functools import lru_cache
from pathlib import Path
from typing import Any

from app.errors import SceneError, SettingsError

LIST = Path(__file__).parents[1] / "validation" / "views.json"


@lru_cache(maxsize=1)
def read_list() -> dict[str, Any]:
    """The content of ``export/validation/views.json``."""
    return json.loads(LIST.read_text("utf-8"))


def refuse_held_out(file: Path) -> None:
    """Refuse a scene file of the validation list, under whatever name.

    Raises
    ------
    SceneError
        When the file does not exist.
    SettingsError
        When it is held out.
    """
    if not file.is_file():
        raise SceneError("no such scene file", file, "expected the path of an existing file")
    files = {name: file for name, file in read_list()["files"].items() if file.get("held_out", True)}
    if {file.stem, file.parent.name} & set(files) or digest(file) in {f["sha256"] for f in files.values()}:
        raise SettingsError("this scene is held out for validation", file, "expected another scene to train on")


@lru_cache(maxsize=16)
def digest(file: Path) -> str:
    """SHA-256 of the file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()
