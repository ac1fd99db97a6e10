"""The environment of a lighting in the scene JSON."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from app.arrays import F32
from app.io.image import read_radiance
from app.load.scene_builder import MAX_RADIANCE
from app.scene import Environment

GRADIENT_ROWS = 512

Notify = Callable[[str], object]


def build_environment(spec: dict[str, Any], folder: Path, notify: Notify) -> Environment | None:
    """The environment that a checked ``spec`` describes; None if it is black.

    Parameters
    ----------
    folder : Path
        The folder that file names are relative to.
    notify : callable
        Receives a notice when values had to be replaced.

    Raises
    ------
    SceneError
        When an image can't be read.
    """
    match spec["type"]:
        case "constant":
            radiance = np.array(spec["radiance"], np.float32).reshape(1, 1, 3)
        case "gradient":
            zenith, horizon, ground = (np.array(spec[key], np.float64) for key in ("zenith", "horizon", "ground"))
            down = (np.arange(GRADIENT_ROWS) + 0.5)[:, None] / (GRADIENT_ROWS / 2)  # 1 at the horizon
            rows = np.where(down < 1, zenith + (horizon - zenith) * down, ground)
            radiance = rows.astype(np.float32)[:, None]
        case _:
            radiance = _read_image(spec, folder / spec["file"], notify)
    return Environment(radiance, float(spec.get("rotation_deg", 0.0)) % 360) if radiance.any() else None


def _read_image(spec: dict[str, Any], path: Path, notify: Notify) -> F32:
    with np.errstate(over="ignore", invalid="ignore"):
        radiance = read_radiance(path) * np.array(spec.get("scale", (1, 1, 1)), np.float32)
        valid = radiance >= 0
    if not valid.all():
        notify(f"{path.name}: {np.count_nonzero(~valid)} values are negative or not a number and count as black")
    return np.where(valid, np.minimum(radiance, np.float32(MAX_RADIANCE)), np.float32(0))
