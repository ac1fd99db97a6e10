"""The mutations of ``mutations.toml``, and their table in ``docs/testing.md``.

``python -m tests.golden.mutations`` rewrites the table.
"""

from __future__ import annotations

import tomllib
from dataclasses import astuple, dataclass
from pathlib import Path

from tests.mutated_shaders import Replacement

FILE = Path(__file__).with_name("mutations.toml")
PAGE = Path(__file__).parents[2] / "docs" / "testing.md"
HEAD = "| shader | text | replacement | scene | first broken stage |\n|---|---|---|---|---|\n"


@dataclass(frozen=True)
class Mutation(Replacement):
    """It breaks the goldens of ``scene``, those of ``stage`` first."""

    scene: str
    stage: str

    def __str__(self) -> str:
        return f"{self.shader} {self.scene} {self.stage}"


def read_mutations() -> list[Mutation]:
    return [Mutation(**entry) for entry in tomllib.loads(FILE.read_text("utf-8"))["mutation"]]


def table() -> str:
    """The mutations as a Markdown table."""
    return HEAD + "".join("| " + " | ".join(f"`{cell}`" for cell in astuple(m)) + " |\n" for m in read_mutations())


def page_with_table(page: str) -> str:
    """``page`` with its table of mutations replaced by the current one."""
    before, head, rest = page.partition(HEAD)
    assert head, f"no table with the head {HEAD!r}"
    return before + table() + rest[rest.index("\n\n") + 1:]


if __name__ == "__main__":
    PAGE.write_text(page_with_table(PAGE.read_text("utf-8")), "utf-8")
