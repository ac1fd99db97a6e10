"""Compares models along camera paths: their indirect light over time beside the path-traced reference's."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.arrays import F32
from app.evaluation.configurations import Configuration
from app.evaluation.reference import cache_folder
from app.extras import extra_module
from app.io.atomic_files import replace_file
from app.math3d import LUMINANCE
from app.renderer import Renderer
from app.settings import Settings
from export.validation.camera_paths import CameraPathCase
from export.validation.errors import Progress, find_configurations
from export.validation.path_references import PathReference, reference_of
from export.validation.temporal import (
    FrameSequence,
    frame_errors,
    gradient_energy,
    luminance_errors,
    luminances,
    temporal_error,
)

REFERENCE = "reference"
SIZE, QUICK_SIZE = (256, 192), (96, 72)
MAX_ERROR_RATIO = 1.2        # temporal error, relative to the reference's
MAX_DEVIATION = 0.2          # of mean and gradient energy, relative to the reference's
MAX_LUMINANCE_ERROR = 0.15   # of any frame, relative to the reference's luminance ...
MIN_LUMINANCE_ERROR = 0.02   # ... or, if larger, this relative to its maximum over all frames


@dataclass(frozen=True)
class Row:
    """One model, or the reference itself, on one camera path.

    Attributes
    ----------
    luminance, direct : list of float
        Means of each frame, W/(sr m²): indirect light / albedo, and the reference's direct light.
    errors : list of float
        Root mean square error of indirect light / albedo in each frame, W/(sr m²).
    max_luminance_error : float
        Largest relative error of a frame's luminance; see ``luminance_errors``.
    mean : float
        Luminance over all frames, relative to the reference's.
    gradient : float or None
        Gradient energy over all frames, relative to the reference's; None if noise hides that.
    error : float or None
        Temporal error relative to the reference's mean luminance; None if evaluated frames are not consecutive.
    error_ratio : float or None
        Temporal error relative to the reference's own; None also if noise hides that.
    """

    path: str
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
        """Whether light is as steady and sharp as the reference's, or as bright; None if noise hides that."""
        if self.error is None:
            return self.max_luminance_error <= MAX_LUMINANCE_ERROR
        if self.error_ratio is None or self.gradient is None:
            return None
        deviation = max(abs(self.mean - 1), abs(self.gradient - 1))
        return self.error_ratio <= MAX_ERROR_RATIO and deviation <= MAX_DEVIATION


def compare_on_paths(cases: Sequence[CameraPathCase], models: Sequence[str], size: tuple[int, int], spp: int,
                     references: Path | None, provider: str, progress: Progress) -> list[Row]:
    """Rows of the reference and of every model on every camera path.

    Parameters
    ----------
    models : sequence of str
        Texts for ``app.network.selection.find_models``.
    spp : int
        Paths per pixel of the reference, half of them for each of its two estimates.

    Raises
    ------
    AfterglowError
        When a model, the path tracer or the device is not available.
    """
    configurations = find_configurations(models, size)
    rows = []
    for case in cases:
        reference = reference_of(case, size, spp, references or cache_folder(), progress)
        rows.append(_row(case, REFERENCE, reference.indirect, reference))
        for configuration in configurations:
            progress(f"{case.name}: {configuration.label}")
            light = draw(case, configuration, provider)
            rows.append(_row(case, configuration.label, FrameSequence(light, light), reference))
    return rows


def draw(case: CameraPathCase, configuration: Configuration, provider: str) -> F32:
    """Indirect light of the evaluated frames, shape (F, H, W, 3), accumulated over all drawn frames.

    Without the finished picture among the outputs nothing jitters, so light is sampled at pixel centres.
    """
    images = []
    settings = Settings(configuration.size, ("indirect",), provider=provider)
    with Renderer(case.scene, settings, configuration.models) as renderer:
        for k, (camera, time) in enumerate(case.drawn):
            if k % case.frame_step:
                renderer.advance(camera, time)
            else:
                images.append(renderer.render(camera, time)["indirect"])
    return np.stack(images)


def plot(rows: Sequence[Row], path: Path) -> None:
    """Plot luminance and errors of one path's rows over its frames, and shade frames without direct light in view."""
    figure = extra_module("matplotlib.figure", "evaluation").Figure(figsize=(11, 4), layout="constrained")
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
        axes.set(title=rows[0].path, xlabel="frame")
        axes.grid(alpha=0.3)
    luminance.legend()
    with replace_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=100)


def _row(case: CameraPathCase, model: str, light: FrameSequence, reference: PathReference) -> Row:
    surfaces = reference.surfaces
    luminance, expected = (luminances(sequence, surfaces) for sequence in (light, reference.indirect))
    mean = float(np.mean(expected))
    reference_gradient = gradient_energy(reference.indirect, surfaces)
    error, reference_error = (temporal_error(sequence, surfaces) if case.consecutive else None
                              for sequence in (light, reference.indirect))
    direct = (reference.direct.astype(np.float64) @ LUMINANCE).mean(axis=(1, 2)).tolist()
    floor = MIN_LUMINANCE_ERROR / MAX_LUMINANCE_ERROR
    return Row(case.name, model, luminance, direct, frame_errors(light.first, reference.indirect, surfaces),
               max_luminance_error=max(luminance_errors(luminance, expected, floor)),
               mean=float(np.mean(luminance)) / mean,
               gradient=gradient_energy(light, surfaces) / reference_gradient if reference_gradient else None,
               error=None if error is None else error / mean,
               error_ratio=error / reference_error if error is not None and reference_error else None)
