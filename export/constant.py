"""The one factor that brings a network's light nearest to a dataset's targets: a floor that needs no training."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from app.errors import SettingsError
from app.renderer import Renderer
from app.settings import Settings
from export.dataset import Dataset
from export.dataset.target import picked


def fitted_constant(dataset: Dataset, model: Path, pairs: int) -> float:
    """Least squares of c · light − target over evenly spread pairs, each frame relative to its target's own square.

    Raises
    ------
    SettingsError
        When no light of the model meets a target that is not black.
    """
    products = squares = 0.0
    for index in np.unique(np.linspace(0, len(dataset) - 1, min(pairs, len(dataset))).astype(int)).tolist():
        still, target = dataset.pair(index).current, dataset.target(index)
        with Renderer(still.scene, Settings(still.size, ("indirect",), taa=False, provider="cpu"), model) as renderer:
            drawn = renderer.render(still.camera, still.time)["indirect"]
        columns, rows = np.moveaxis((picked(still.size) * still.size).astype(int), -1, 0)
        light, truth = drawn[rows, columns][target.seen], target.layers["indirect"][target.seen]
        weight = 1 / max(float((truth.astype(np.float64) ** 2).sum()), 1e-30)
        products += weight * float((light * truth).sum(dtype=np.float64))
        squares += weight * float((light * light).sum(dtype=np.float64))
    if not (products > 0 and squares > 0):
        raise SettingsError("no light to fit a constant to", dataset.folder, "expected pairs that are lit")
    return products / squares
