"""Copies of the shaders in which one text is replaced, to see which test notices."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from app.paths import shader_dir


@dataclass(frozen=True)
class Replacement:
    """Of the text ``old`` by ``new`` in ``shader``."""

    shader: str
    old: str
    new: str


def assert_replaces_one_text(replacement: Replacement) -> None:
    """``old`` occurs once, on one line."""
    assert (shader_dir() / replacement.shader).read_text("utf-8").count(replacement.old) == 1
    assert "\n" not in replacement.old and replacement.old != replacement.new


def mutated_shaders(replacement: Replacement, folder: Path) -> Path:
    """A copy of the shaders in ``folder`` after the replacement, for the variable ``app.paths.SHADERS``."""
    shaders = Path(shutil.copytree(shader_dir(), folder / "shaders"))
    path = shaders / replacement.shader
    path.write_text(path.read_text("utf-8").replace(replacement.old, replacement.new), "utf-8")
    return shaders
