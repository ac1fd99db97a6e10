"""The table of docs/testing.md: each mutation of a shader breaks a golden, and the check names its stage first.

The table itself is checked in every run; repeating it takes minutes and carries the marker ``mutation``.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest

from app.golden import catalogue, check
from app.paths import SHADERS, shader_dir

ROOT = Path(__file__).parents[2]
IMAGES = Path(__file__).parent / "images"
ROW = re.compile(r"^\| `([^`]+)` \| `([^`]+)` \| `([^`]*)` \| `([^`]+)` \| `([^`]+)` \|$", re.MULTILINE)


@dataclass(frozen=True)
class Mutation:
    """In ``shader`` ``old`` becomes ``new``; then the goldens of ``scene`` break, first those of ``stage``."""

    shader: str
    old: str
    new: str
    scene: str
    stage: str

    def __str__(self) -> str:
        return f"{self.shader} {self.scene} {self.stage}"


TABLE = [Mutation(*row) for row in ROW.findall((ROOT / "docs" / "testing.md").read_text("utf-8"))]


def test_every_entry_and_every_include_has_a_mutation() -> None:
    files = {str(f.relative_to(shader_dir())) for f in shader_dir().rglob("*.*") if f.is_file()}
    assert {m.shader for m in TABLE} == files


@pytest.mark.parametrize("mutation", TABLE, ids=str)
def test_a_mutation_replaces_one_text_on_one_line(mutation: Mutation) -> None:
    assert (shader_dir() / mutation.shader).read_text("utf-8").count(mutation.old) == 1
    assert mutation.old != mutation.new
    assert mutation.scene in catalogue()


@pytest.mark.gl
@pytest.mark.mutation
@pytest.mark.parametrize("mutation", TABLE, ids=str)
def test_a_mutation_breaks_its_stage_first(mutation: Mutation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shaders = Path(shutil.copytree(shader_dir(), tmp_path / "shaders"))
    path = shaders / mutation.shader
    path.write_text(path.read_text("utf-8").replace(mutation.old, mutation.new), "utf-8")
    monkeypatch.setenv(SHADERS, str(shaders))
    broken = check([catalogue()[mutation.scene]], IMAGES).broken
    assert broken, "the check noticed nothing"
    assert (broken[0].stage, broken[0].verdict) == (mutation.stage, "differs")
