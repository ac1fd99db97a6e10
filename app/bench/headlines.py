"""The two figures that sum a benchmark up: speed-up at equal error, error ratio at equal time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from app.bench.baselines import DENOISED, TRACED
from app.bench.pareto import Point, Ratio, error_ratio, mean_ratio, speed_up
from app.evaluation.timing import FRAME
from app.network.contract import SSGI

HEADLINE_ERROR = ("final", "flip")

Json = dict[str, Any]


def headlines(scenes: Sequence[Json]) -> list[Json]:
    """Both figures of each network against each baseline: their geometric means, and each scene's own."""
    found: dict[tuple[str, str], dict[str, tuple[Ratio, Ratio]]] = {}
    for scene in scenes:
        curves = points_of(scene)
        for label in networks(scene):
            ours = curves[label][0]
            for name, baseline in opponents(curves).items():
                both = speed_up(ours, baseline), error_ratio(ours, baseline)
                found.setdefault((label, name), {})[scene["name"]] = both
    return [{"model": label, "against": name,
             **_both(mean_ratio([s for s, _ in rows.values()]), mean_ratio([e for _, e in rows.values()])),
             "scenes": {scene: _both(*row) for scene, row in rows.items()}} for (label, name), rows in found.items()]


def points_of(scene: Json) -> dict[str, list[Point]]:
    """Time against the headline error: a point for each judged configuration, and a curve for each baseline."""
    layer, metric = HEADLINE_ERROR
    curves: dict[str, list[Point]] = {}
    for c in scene["configurations"]:
        if c["errors"] is not None:
            curves[c["label"]] = [Point(c["label"], c["stages"][FRAME]["median"], c["errors"][layer][metric])]
    for r in scene["baselines"]:
        curves.setdefault(r["name"], []).append(Point(r["name"], r["ms"], r["errors"][layer][metric]))
    return curves


def networks(scene: Json) -> list[str]:
    """Labels of the judged networks."""
    return [c["label"] for c in scene["configurations"] if c["errors"] is not None and c["grid"] is not None]


def opponents(curves: dict[str, list[Point]]) -> dict[str, list[Point]]:
    """The denoised path tracer of whatever quality is best, the bare one, and the classical method."""
    denoised = [p for name, points in curves.items() if name.startswith(DENOISED) for p in points]
    found = {f"{TRACED}, {DENOISED}": denoised} if denoised else {}
    return found | {name: curves[name] for name in (TRACED, SSGI) if name in curves}


def _both(faster: Ratio, nearer: Ratio) -> Json:
    return {"speed_up": faster.to_json(), "error_ratio": nearer.to_json()}
