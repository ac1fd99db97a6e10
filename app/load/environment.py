"""The environment of a lighting in the scene JSON."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from app.io.image import read_radiance
from app.load.scene_builder import BRIGHTEST
from app.scene import Environment

GRADIENT_ROWS = 512

Notice = Callable[[str], object]


def environment(spec: dict[str, Any], folder: Path, notice: Notice) -> Environment | None:
    """What a checked ``spec`` describes; None where it is black.

    Parameters
    ----------
    folder : Path
        That file names are relative to.
    notice : callable
        Is told what had to be mended.

    Raises
    ------
    SceneError
        When an image can't be read.
    """
    made = _KINDS[spec["type"]](spec, folder, notice)
    return made if made.radiance.any() else None


def _constant(spec: dict[str, Any], folder: Path, notice: Notice) -> Environment:
    return Environment(np.array(spec["radiance"], np.float32).reshape(1, 1, 3))


def _gradient(spec: dict[str, Any], folder: Path, notice: Notice) -> Environment:
    zenith, horizon, ground = (np.array(spec[key], np.float64) for key in ("zenith", "horizon", "ground"))
    down = (np.arange(GRADIENT_ROWS) + 0.5)[:, None] / (GRADIENT_ROWS / 2)  # 1 at the horizon
    rows = np.where(down < 1, zenith + (horizon - zenith) * down, ground)
    return Environment(rows.astype(np.float32)[:, None])


def _image(spec: dict[str, Any], folder: Path, notice: Notice) -> Environment:
    path = folder / spec["file"]
    with np.errstate(over="ignore", invalid="ignore"):
        radiance = read_radiance(path) * np.array(spec.get("scale", (1, 1, 1)), np.float32)
        sound = radiance >= 0
    if not sound.all():
        notice(f"{path.name}: {np.count_nonzero(~sound)} values are no light and count as black")
    radiance = np.where(sound, np.minimum(radiance, np.float32(BRIGHTEST)), np.float32(0))
    return Environment(radiance, float(spec.get("rotation_deg", 0.0)) % 360)


_KINDS: dict[str, Callable[[dict[str, Any], Path, Notice], Environment]] = {
    "constant": _constant, "gradient": _gradient, "image": _image}
