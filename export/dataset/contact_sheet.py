"""A contact sheet of a dataset: the renderer's direct light and emission, with the traced indirect light."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from app.evaluation.metrics import exposure_of, tone_map
from app.io.atomic_files import replacing
from app.renderer import Renderer
from app.settings import Settings
from export.dataset.dataset import Dataset

COLUMNS = 8
WIDTH = 160  # pixels of each picture
QUALITY = 80


def write_contact_sheet(dataset: Dataset, out: Path, count: int) -> None:
    """Write the first ``count`` pairs as one picture, in the order of their sources."""
    chosen = sorted(range(min(count, len(dataset))), key=dataset.source)
    pictures = [_picture(dataset, index) for index in chosen]
    width, height = pictures[0].size
    sheet = Image.new("RGB", (COLUMNS * width, -(-len(pictures) // COLUMNS) * height))
    for k, picture in enumerate(pictures):
        sheet.paste(picture, (k % COLUMNS * width, k // COLUMNS * height))
    with replacing(out) as temporary:
        sheet.save(temporary, "jpeg", quality=QUALITY)


def _picture(dataset: Dataset, index: int) -> Image.Image:
    still, target = dataset.pair(index).current, dataset.target(index)
    settings = Settings(still.size, ("direct", "albedo", "emission"), taa=False)
    with Renderer(still.scene, settings) as renderer:
        images = renderer.render(still.camera, still.time)
    indirect = target.layers["indirect"].repeat(2, axis=0).repeat(2, axis=1)
    final = images["direct"] + images["emission"] + images["albedo"] * indirect
    picture = Image.fromarray((255 * tone_map(final, exposure_of(final))).astype(np.uint8))
    return picture.resize((WIDTH, WIDTH * still.size[1] // still.size[0]), Image.Resampling.LANCZOS)
