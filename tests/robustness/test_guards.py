"""Each guard of ``guards.toml`` is needed: without it, its test fails.

The table itself is checked in every run; running the tests without the guards takes minutes and has the marker
``mutation``.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest

from app.paths import SHADERS, shader_dir

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Guard:
    """Replacing ``old`` by ``new`` in ``shader`` makes ``test`` fail."""

    shader: str
    old: str
    new: str
    test: str

    def __str__(self) -> str:
        return f"{self.shader} {self.test.partition('::')[2]}"


TABLE = Path(__file__).with_name("guards.toml")
GUARDS = [Guard(**entry) for entry in tomllib.loads(TABLE.read_text("utf-8"))["guard"]]


@pytest.mark.parametrize("guard", GUARDS, ids=str)
def test_a_guard_is_one_text_on_one_line_and_has_a_test(guard: Guard) -> None:
    assert (shader_dir() / guard.shader).read_text("utf-8").count(guard.old) == 1
    assert "\n" not in guard.old and guard.old != guard.new
    file, _, name = guard.test.partition("::")
    assert f"def {name.partition('[')[0]}(" in (ROOT / file).read_text("utf-8")


@pytest.mark.gl
@pytest.mark.mutation
@pytest.mark.parametrize("guard", GUARDS, ids=str)
def test_without_the_guard_its_test_fails(guard: Guard, tmp_path: Path) -> None:
    shaders = Path(shutil.copytree(shader_dir(), tmp_path / "shaders"))
    path = shaders / guard.shader
    path.write_text(path.read_text("utf-8").replace(guard.old, guard.new), "utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "0", "-p", "no:cacheprovider", guard.test]
    found = subprocess.run(command, cwd=ROOT, env={**os.environ, SHADERS: str(shaders)}, capture_output=True, text=True)
    assert found.returncode == pytest.ExitCode.TESTS_FAILED, found.stdout
