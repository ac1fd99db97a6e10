"""How long the frames of models take on the validation scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from statistics import fmean

from app.bench.configurations import expand
from app.bench.measure import FRAME, Contender, Race
from export.judge import ALL
from export.validation import View

TURNS = 3

Milliseconds = dict[str, dict[str, float]]  # by scene and model


def frame_times(views: Sequence[View], models: Sequence[str], size: tuple[int, int], provider: str,
                progress: Callable[[str], object]) -> Milliseconds:
    """Median milliseconds of a frame while the camera moves: of the first view of each scene, and their mean."""
    found: Milliseconds = {}
    configurations, _ = expand(models, [size])
    for view in views:
        if view.scene in found:
            continue
        progress(f"timing {view.name}")
        contenders = [Contender(view.still.scene, view.still.camera, c) for c in configurations]
        with Race(contenders, provider) as race:
            for _ in range(TURNS):
                race.turn()
        found[view.scene] = {c.configuration.label: c.stages[FRAME].median for c in contenders}
    labels = next(iter(found.values()), {})
    return {**found, ALL: {label: fmean(times[label] for times in found.values()) for label in labels}}
