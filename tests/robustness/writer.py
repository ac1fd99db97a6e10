"""Writes the same files again and again, first and second version in turn, until it is killed.

``python -m tests.robustness.writer FOLDER``; a line on stdout says that the first round is done.
"""

from __future__ import annotations

import itertools
import json
import sys
from pathlib import Path

import numpy as np

from app.io.atomic_files import replace_folder, write_text
from app.io.image import write_exr, write_png

VERSIONS = 2
SIDE = 128
PARTS = 4


def image(version: int) -> np.ndarray:
    """Half floats that differ everywhere between versions, and don't compress."""
    return np.random.default_rng(version).uniform(0, 1, (SIDE, SIDE, 3)).astype(np.float16)


def display(version: int) -> np.ndarray:
    return np.random.default_rng(version).integers(0, 255, (SIDE, SIDE, 3)).astype(np.uint8)


def text(version: int) -> str:
    return json.dumps({"version": version, "values": list(range(20_000))})


def write(folder: Path, version: int) -> None:
    """One round: an image of each kind, a JSON file, and a folder of files."""
    write_exr(folder / "image.exr", {"": image(version)})
    write_png(folder / "image.png", display(version))
    write_text(folder / "report.json", text(version))
    with replace_folder(folder / "goldens") as fresh:
        for part in range(PARTS):
            (fresh / f"{part}.json").write_text(text(version))


if __name__ == "__main__":
    for turn in itertools.count():
        write(Path(sys.argv[1]), turn % VERSIONS)
        if turn == 0:
            print("written", flush=True)
