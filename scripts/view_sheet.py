"""Draws validation views by several models beside the truth: a row for each view, models in columns, the truth last.

``python scripts/view_sheet.py OUT.jpg --views room-0-1,sponza-sun-2 none bcnn-8 nets/gfa-8.onnx``
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from PIL import Image, ImageDraw

sys.path.insert(0, str(Path(__file__).parents[1]))

from app.bench.configurations import expand
from app.bench.judge import draw_layers
from app.metrics import exposure_of, tone_map
from export.judge import truth_of
from export.validation import SCENES, views

QUALITY = 88


def main(out: Path, models: list[str], chosen: Annotated[str, typer.Option("--views")],
         spp: int = 128, truth: Path | None = None, scenes: Path = SCENES) -> None:
    """Write the sheet; every picture has its truth's exposure."""
    names = chosen.split(",")
    rows = []
    for view in (v for v in views(scenes) if v.name in names):
        final = truth_of(view, spp, truth).layers["final"]
        configurations, _ = expand(models, [view.still.size])
        drawn = {c.label: draw_layers(view.still.scene, view.still.camera, c, "cpu")["final"] for c in configurations}
        exposure = exposure_of(final)
        shown = [_labelled(tone_map(x, exposure), label) for label, x in {**drawn, "truth": final}.items()]
        rows.append(np.concatenate(shown, axis=1))
    Image.fromarray(np.concatenate(rows)).save(out, quality=QUALITY)


def _labelled(picture: np.ndarray, label: str) -> np.ndarray:
    image = Image.fromarray((255 * picture).astype(np.uint8))
    ImageDraw.Draw(image).text((4, 2), label, fill="white", stroke_width=1, stroke_fill="black")
    return np.asarray(image)


if __name__ == "__main__":
    typer.run(main)
