"""A contact sheet of a dataset: ``python scripts/dataset_sheet.py DATASET sheet.jpg``.

Each picture is the renderer's direct light and emission, with the traced indirect light of the target.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import typer
from PIL import Image

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from app.metrics import exposure_of, tone_map
from app.renderer import Renderer
from app.settings import Settings
from export.dataset import Dataset

COLUMNS = 8
WIDTH = 160
QUALITY = 80


def main(dataset: Path, out: Path, count: int = 40) -> None:
    """Write the first ``count`` pairs, in the order of their sources."""
    opened = Dataset(dataset)
    chosen = sorted(range(min(count, len(opened))), key=opened.source)
    pictures = [_picture(opened, index) for index in chosen]
    width, height = pictures[0].size
    sheet = Image.new("RGB", (COLUMNS * width, -(-len(pictures) // COLUMNS) * height))
    for k, picture in enumerate(pictures):
        sheet.paste(picture, (k % COLUMNS * width, k // COLUMNS * height))
    sheet.save(out, quality=QUALITY)


def _picture(dataset: Dataset, index: int) -> Image.Image:
    still, target = dataset.pair(index).current, dataset.target(index)
    settings = Settings(still.size, ("direct", "albedo", "emission"), taa=False)
    with Renderer(still.scene, settings) as renderer:
        images = renderer.render(still.camera, still.time)
    indirect = target.layers["indirect"].repeat(2, axis=0).repeat(2, axis=1)
    final = images["direct"] + images["emission"] + images["albedo"] * indirect
    picture = Image.fromarray((255 * tone_map(final, exposure_of(final))).astype(np.uint8))
    return picture.resize((WIDTH, WIDTH * still.size[1] // still.size[0]), Image.Resampling.LANCZOS)


if __name__ == "__main__":
    typer.run(main)
