"""Frame times of models on the validation scenes."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

from app.evaluation.timing import FRAME, InterleavedTimer, TimedRun
from app.network.selection import NONE
from export.validation.errors import ALL, Progress, find_configurations
from export.validation.views import View

ROUNDS = 3


@dataclass(frozen=True)
class FrameTimes:
    """Frame times of a run.

    Attributes
    ----------
    size : tuple of int
        Width and height in pixels.
    device : str
        GL renderer and execution providers.
    milliseconds : dict of str to dict
        Medians by scene (or ``mean``) and model.
    """

    size: tuple[int, int]
    device: str
    milliseconds: dict[str, dict[str, float]]


def frame_times(views: Sequence[View], models: Sequence[str], size: tuple[int, int], provider: str,
                progress: Progress) -> FrameTimes:
    """Median frame times with a moving camera, on the first view of each scene, and their means."""
    milliseconds: dict[str, dict[str, float]] = {}
    devices: dict[str, None] = {}
    configurations = find_configurations(models, size)
    for view in views:
        if view.scene in milliseconds:
            continue
        progress(f"timing {view.name}")
        runs = [TimedRun(view.still.scene, view.still.camera, c) for c in configurations]
        with InterleavedTimer(runs, provider) as timer:
            for _ in range(ROUNDS):
                timer.run_round()
        devices |= dict.fromkeys(run.device["gl_renderer"] for run in runs)
        devices |= dict.fromkeys(run.device["provider"] for run in runs if run.device["provider"] != NONE)
        milliseconds[view.scene] = {run.configuration.label: run.stages[FRAME].median for run in runs}
    labels = next(iter(milliseconds.values()), {})
    means = {label: fmean(times[label] for times in milliseconds.values()) for label in labels}
    return FrameTimes(size, ", ".join(devices), {**milliseconds, ALL: means})
