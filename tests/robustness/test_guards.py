"""Each guard of ``guards.toml`` protects from something: a test fails without it.

The table itself is checked in every run; removing the guards takes minutes and has the marker ``mutation``.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest

from app.paths import SHADERS
from tests.mutated_shaders import Replacement, assert_replaces_one_text, mutated_shaders

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Guard(Replacement):
    """It removes the guard, and ``test``, a node of pytest, fails."""

    test: str

    def __str__(self) -> str:
        return f"{self.shader} {self.test.rpartition('::')[2]}"


TABLE = tomllib.loads(Path(__file__).with_name("guards.toml").read_text("utf-8"))
GUARDS = [Guard(**entry) for entry in TABLE["guard"]]


@pytest.mark.parametrize("guard", GUARDS, ids=str)
def test_an_entry_removes_one_text_and_names_a_test(guard: Guard) -> None:
    assert_replaces_one_text(guard)
    file, function = guard.test.partition("[")[0].split("::")
    tree = ast.parse((ROOT / file).read_text("utf-8"))
    assert function in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


@pytest.mark.gl
@pytest.mark.mutation
@pytest.mark.usefixtures("egl")
@pytest.mark.parametrize("guard", GUARDS, ids=str)
def test_without_a_guard_its_test_fails(guard: Guard, tmp_path: Path) -> None:
    """By what it asserts, not by an error such as that of a shader that doesn't compile."""
    child = subprocess.run([sys.executable, "-m", "pytest", "-x", "--tb=native", "-p", "no:cacheprovider", guard.test],
                           cwd=ROOT, env={**os.environ, SHADERS: str(mutated_shaders(guard, tmp_path))},
                           capture_output=True, text=True, check=False)
    assert child.returncode == pytest.ExitCode.TESTS_FAILED, child.stdout + child.stderr
    assert "AssertionError" in child.stdout, child.stdout
