"""A contact sheet of a dataset: the renderer's direct light and emission with the traced indirect light."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from app.arrays import F32
from app.evaluation.metrics import exposure_of, tone_map
from app.io.atomic_files import replace_file
from app.renderer import Renderer
from app.settings import Settings
from export.dataset.dataset import Dataset

COLUMNS = 8
THUMBNAIL_WIDTH = 160  # pixels
JPEG_QUALITY = 80


def write_contact_sheet(dataset: Dataset, out: Path, count: int) -> None:
    """Write the first ``count`` pairs as one image, sorted by source."""
    indices = sorted(range(min(count, len(dataset))), key=dataset.source)
    thumbnails = [_thumbnail(dataset, index) for index in indices]
    with replace_file(out) as temporary:
        tile(thumbnails).save(temporary, "jpeg", quality=JPEG_QUALITY)


def tile(pictures: Sequence[Image.Image]) -> Image.Image:
    """Pictures of one size in rows of ``COLUMNS``."""
    width, height = pictures[0].size
    sheet = Image.new("RGB", (COLUMNS * width, -(-len(pictures) // COLUMNS) * height))
    for k, picture in enumerate(pictures):
        sheet.paste(picture, (k % COLUMNS * width, k // COLUMNS * height))
    return sheet


def picture_of(final: F32) -> Image.Image:
    """A linear image, shape (H, W, 3), exposed and tone-mapped."""
    return Image.fromarray((255 * tone_map(final, exposure_of(final))).astype(np.uint8))


def _thumbnail(dataset: Dataset, index: int) -> Image.Image:
    still, target = dataset.pair(index).current, dataset.target(index)
    settings = Settings(still.size, ("direct", "albedo", "emission"), taa=False)
    with Renderer(still.scene, settings) as renderer:
        images = renderer.render(still.camera, still.time)
    indirect = target.layers["indirect"].repeat(2, axis=0).repeat(2, axis=1)
    final = images["direct"] + images["emission"] + images["albedo"] * indirect
    size = THUMBNAIL_WIDTH, THUMBNAIL_WIDTH * still.size[1] // still.size[0]
    return picture_of(final).resize(size, Image.Resampling.LANCZOS)
