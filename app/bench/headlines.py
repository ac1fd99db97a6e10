"""The two headline figures of a benchmark: speed-up at equal error, and error ratio at equal time."""

from collections.abc import Sequence
from dataclasses import asdict

from app.bench.baselines import DENOISED, TRACED
from app.bench.pareto import Point, Ratio, error_ratio, mean_ratio, speed_up
from app.bench.records import Json
from app.evaluation.timing import FRAME
from app.network.selection import SSGI

HEADLINE_ERROR = ("final", "flip")
FIGURES = {"speed_up": speed_up, "error_ratio": error_ratio}


def headlines(scenes: Sequence[Json]) -> list[Json]:
    """Both figures of each network against each baseline: geometric means, and the figures of each scene."""
    ratios: dict[tuple[str, str], dict[str, dict[str, Ratio]]] = {}
    for scene in scenes:
        curves = points_of(scene)
        for label in networks_of(scene):
            for name, curve in baselines_of(curves).items():
                of_scene = {figure: compare(curves[label][0], curve) for figure, compare in FIGURES.items()}
                ratios.setdefault((label, name), {})[scene["name"]] = of_scene
    return [{"model": label, "against": name,
             **{figure: asdict(mean_ratio([row[figure] for row in rows.values()])) for figure in FIGURES},
             "scenes": {scene: {figure: asdict(ratio) for figure, ratio in row.items()} for scene, row in rows.items()}}
            for (label, name), rows in ratios.items()]


def points_of(scene: Json) -> dict[str, list[Point]]:
    """Time against headline error: one point per configuration that has errors, and a curve per baseline."""
    layer, metric = HEADLINE_ERROR
    curves: dict[str, list[Point]] = {}
    for c in scene["configurations"]:
        if c["errors"] is not None:
            curves[c["label"]] = [Point(c["stages"][FRAME]["median"], c["errors"][layer][metric])]
    for b in scene["baselines"]:
        curves.setdefault(b["name"], []).append(Point(b["ms"], b["errors"][layer][metric]))
    return curves


def networks_of(scene: Json) -> list[str]:
    """Labels of the networks that have errors."""
    return [c["label"] for c in scene["configurations"] if c["errors"] is not None and c["grid"] is not None]


def baselines_of(curves: dict[str, list[Point]]) -> dict[str, list[Point]]:
    """The denoised path tracer at its better quality, the raw path tracer, and the classical method."""
    denoised = [point for name, points in curves.items() if name.startswith(DENOISED) for point in points]
    combined = {f"{TRACED}, {DENOISED}": denoised} if denoised else {}
    return combined | {name: curves[name] for name in (TRACED, SSGI) if name in curves}
