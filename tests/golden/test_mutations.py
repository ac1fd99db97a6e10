"""Each mutation of a shader in ``mutations.toml`` breaks a golden, and the check names its stage first.

The table itself is checked in every run; repeating the mutations takes minutes and has the marker ``mutation``.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from app.golden import catalogue, check
from app.paths import SHADERS, shader_dir
from tests.golden.mutations import PAGE, Mutation, page_with_table, read_mutations
from tests.mutated_shaders import assert_replaces_one_text, mutated_shaders

IMAGES = Path(__file__).parent / "images"
MUTATIONS = read_mutations()


def test_every_entry_and_every_include_has_a_mutation() -> None:
    files = {str(f.relative_to(shader_dir())) for f in shader_dir().rglob("*.*") if f.is_file()}
    assert {m.shader for m in MUTATIONS} == files


def test_the_documentation_has_the_table() -> None:
    """Otherwise run ``python -m tests.golden.mutations``."""
    page = PAGE.read_text("utf-8")
    assert page == page_with_table(page)


@pytest.mark.parametrize("mutation", MUTATIONS, ids=str)
def test_a_mutation_replaces_one_text_on_one_line(mutation: Mutation) -> None:
    assert_replaces_one_text(mutation)
    assert mutation.scene in catalogue()


@pytest.mark.gl
@pytest.mark.mutation
@pytest.mark.parametrize("mutation", MUTATIONS, ids=str)
def test_a_mutation_breaks_its_stage_first(mutation: Mutation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(SHADERS, str(mutated_shaders(mutation, tmp_path)))
    broken = check([catalogue()[mutation.scene]], IMAGES).broken
    assert broken, "the check noticed nothing"
    assert (broken[0].stage, broken[0].verdict) == (mutation.stage, "differs")
