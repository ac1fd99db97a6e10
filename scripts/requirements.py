"""Print the requirements of ``pyproject.toml``, with the extras named on the command line, one per line."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path


def requirements(extras: list[str]) -> list[str]:
    """Runtime requirements, then those of each extra; an extra may name others as ``afterglow[OTHER,…]``."""
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text("utf-8"))["project"]

    def of(extra: str) -> list[str]:
        lines = []
        for line in project["optional-dependencies"][extra]:
            own = re.fullmatch(rf"{project['name']}\[(.*)\]", line)
            lines += [inner for other in own[1].split(",") for inner in of(other)] if own else [line]
        return lines

    return project["dependencies"] + [line for extra in extras for line in of(extra)]


if __name__ == "__main__":
    print("\n".join(requirements(sys.argv[1:])))
