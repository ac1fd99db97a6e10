"""Judges models on camera_paths: their indirect light over time beside the path-traced reference's."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.errors import SettingsError
from app.evaluation.configurations import expand
from app.evaluation.metrics import LUMINANCE
from app.evaluation.reference import cache_folder
from app.extras import extra_module
from app.io.atomic_files import replacing
from app.network.contract import Model
from app.renderer import Renderer
from app.settings import Settings
from export.validation.camera_paths import CameraPathCase
from export.validation.path_references import Progress, Reference, reference_of
from export.validation.temporal import (
    FrameSequence,
    errors,
    gradient_energy,
    luminance_errors,
    luminances,
    temporal_error,
)

F32 = NDArray[np.float32]

REFERENCE = "reference"
SIZE, QUICK_SIZE = (256, 192), (96, 72)
MAX_CHANGE = 1.2       # of the reference's temporal error
MAX_OFF = 0.2          # of the reference's mean and gradient energy
MAX_LUMINANCE_ERROR = 0.15      # of the reference's mean luminance in any frame ...
MIN_LUMINANCE_ERROR = 0.02     # ... or this of its largest


@dataclass(frozen=True)
class Row:
    """One model, or the reference itself, on one walk.

    Attributes
    ----------
    luminance, direct : list of float
        Means of each frame, W/(sr m²): indirect light / albedo, and the reference's direct light.
    errors : list of float
        Root mean square difference from the reference's indirect light / albedo in each frame, W/(sr m²).
    max_luminance_error : float
        Largest difference from the reference's luminance; see ``luminance_errors``.
    mean : float
        Luminance of all frames, relative to the reference's.
    gradient : float or None
        Gradient energy of all frames, relative to the reference's; None where noise hides that.
    error : float or None
        Temporal error relative to the reference's mean luminance; None where judged frames are no neighbours.
    error_ratio : float or None
        The same relative to the reference's own; None also where noise hides that.
    """

    walk: str
    model: str
    luminance: list[float]
    direct: list[float]
    errors: list[float]
    max_luminance_error: float
    mean: float
    gradient: float | None
    error: float | None
    error_ratio: float | None

    @property
    def passes(self) -> bool | None:
        """Whether light stays as steady and sharp as the reference's, or as bright; None where noise hides it."""
        if self.error is None:
            return self.max_luminance_error <= MAX_LUMINANCE_ERROR
        if self.error_ratio is None or self.gradient is None:
            return None
        return self.error_ratio <= MAX_CHANGE and max(abs(self.mean - 1), abs(self.gradient - 1)) <= MAX_OFF


def judge_camera_paths(camera_paths: Sequence[CameraPathCase], models: Sequence[str], size: tuple[int, int], spp: int, references: Path | None,
                provider: str, progress: Progress) -> list[Row]:
    """The reference and every model on every walk.

    Parameters
    ----------
    models : sequence of str
        Texts for ``app.evaluation.configurations.find_models``.
    spp : int
        Paths per pixel of the reference, half of them for each of two estimates.

    Raises
    ------
    AfterglowError
        When a model, the path tracer or the device can't be had.
    """
    configurations, absent = expand(models, [size])
    if absent:
        raise SettingsError("; ".join(absent), "models", "expected models that exist")
    rows = []
    for walk in camera_paths:
        reference = reference_of(walk, size, spp, references or cache_folder(), progress)
        rows.append(_row(walk, REFERENCE, reference.film, reference))
        for c in configurations:
            progress(f"{walk.name}: {c.label}")
            light = draw(walk, c.models, size, provider)
            rows.append(_row(walk, c.label, FrameSequence(light, light), reference))
    return rows


def draw(walk: CameraPathCase, models: Sequence[Model], size: tuple[int, int], provider: str) -> F32:
    """The indirect light of the judged frames, [F, H, W, 3], gathered over all drawn ones from the first on.

    Where the finished picture is not asked for, nothing jitters: light is seen through the pixels' centres.
    """
    images = []
    with Renderer(walk.scene, Settings(size, ("indirect",), provider=provider), models) as renderer:
        for k, (camera, time) in enumerate(zip(walk.cameras, walk.moments, strict=True)):
            if k % walk.apart:
                renderer.advance(camera, time)
            else:
                images.append(renderer.render(camera, time)["indirect"])
    return np.stack(images)


def to_json(rows: Sequence[Row], about: dict[str, Any]) -> str:
    return json.dumps({**about, "rows": [{**asdict(row), "passes": row.passes} for row in rows]}, indent=1) + "\n"


def plot(rows: Sequence[Row], path: Path) -> None:
    """Draw luminance and errors of one walk's rows over its frames, and where no direct light is in view."""
    figure = extra_module("matplotlib.figure", "judge").Figure(figsize=(11, 4), layout="constrained")
    luminance, error = figure.subplots(1, 2)
    dark = [k for k, direct in enumerate(rows[0].direct) if direct == 0]
    for axes in (luminance, error) if dark else ():
        axes.axvspan(dark[0], dark[-1], color="0.92", label="nothing lit in view")
    for row in rows:
        if row.model == REFERENCE:
            luminance.plot(row.luminance, label=row.model, color="black", linewidth=2.5)
            continue
        line, = luminance.plot(row.luminance, label=row.model, marker=".", linewidth=1.2)
        error.plot(row.errors, color=line.get_color(), marker=".", linewidth=1.2)
    luminance.set(ylabel="mean indirect luminance, W/(sr m²)", ylim=(0, None))
    error.set(ylabel="root mean square error of texels, W/(sr m²)", ylim=(0, None))
    for axes in (luminance, error):
        axes.set(title=rows[0].walk, xlabel="frame")
        axes.grid(alpha=0.3)
    luminance.legend()
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=100)


def _row(walk: CameraPathCase, model: str, film: FrameSequence, reference: Reference) -> Row:
    surfaces = reference.surfaces
    found, expected = (luminances(x, surfaces) for x in (film, reference.film))
    mean = float(np.mean(expected))
    sharpness = gradient_energy(reference.film, surfaces)
    error, own = (temporal_error(x, surfaces) if walk.neighbours else None for x in (film, reference.film))
    direct = (reference.direct.astype(np.float64) @ LUMINANCE).mean(axis=(1, 2)).tolist()
    return Row(walk.name, model, found, direct, errors(film.first, reference.film, surfaces),
               max_luminance_error=max(luminance_errors(found, expected, MIN_LUMINANCE_ERROR / MAX_LUMINANCE_ERROR)),
               mean=float(np.mean(found)) / mean,
               gradient=gradient_energy(film, surfaces) / sharpness if sharpness else None,
               error=None if error is None else error / mean,
               error_ratio=error / own if error is not None and own else None)
