"""How long the frames of models take on the validation scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import fmean

from app.evaluation.configurations import NONE, expand
from app.evaluation.timing import FRAME, InterleavedTimer, TimedRun
from export.validation.errors import ALL
from export.validation.views import View

TURNS = 3


@dataclass(frozen=True)
class FrameTimes:
    """How long frames take.

    Attributes
    ----------
    size : tuple of int
        Width and height in pixels.
    device : str
        What draws, and the execution provider of the networks.
    milliseconds : dict of str to dict
        Medians by scene, or ``mean``, and model.
    """

    size: tuple[int, int]
    device: str
    milliseconds: dict[str, dict[str, float]]


def frame_times(views: Sequence[View], models: Sequence[str], size: tuple[int, int], provider: str,
                progress: Callable[[str], object]) -> FrameTimes:
    """Median milliseconds of a frame while the camera moves: of the first view of each scene, and their mean."""
    found: dict[str, dict[str, float]] = {}
    devices: dict[str, None] = {}
    configurations, _ = expand(models, [size])
    for view in views:
        if view.scene in found:
            continue
        progress(f"timing {view.name}")
        timed_runs = [TimedRun(view.still.scene, view.still.camera, c) for c in configurations]
        with InterleavedTimer(timed_runs, provider) as timer:
            for _ in range(TURNS):
                timer.turn()
        devices |= dict.fromkeys(c.device["gl_renderer"] for c in timed_runs)
        devices |= dict.fromkeys(c.device["provider"] for c in timed_runs if c.device["provider"] != NONE)
        found[view.scene] = {c.configuration.label: c.stages[FRAME].median for c in timed_runs}
    labels = next(iter(found.values()), {})
    means = {label: fmean(times[label] for times in found.values()) for label in labels}
    return FrameTimes(size, ", ".join(devices), {**found, ALL: means})
