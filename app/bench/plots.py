"""The report's figures, as SVG texts without fonts or files of their own."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from typing import Any

from app.bench.baselines import NAMES
from app.bench.headlines import HEADLINE_ERROR, networks, points_of
from app.bench.pareto import pareto_front
from app.evaluation.configurations import NONE
from app.evaluation.timing import FRAME, YARDSTICK
from app.extras import extra_module
from app.network.contract import SSGI

Json = dict[str, Any]

COLUMNS = 3
BASELINE_STYLES = dict(zip(NAMES, (("#999999", "o"), ("#6aa2d8", "s"), ("#2f6db3", "D")), strict=True))
GREY = "#555555"
NETWORK_COLOURS = ("#d1495b", "#e8963e", "#7b4fa3", "#2a9d8f", "#8a6d3b", "#c46bae", "#7a9e2f", "#1f4e79")
STAGES_LEFT_OUT = (FRAME, YARDSTICK)


def scatter(results: Json) -> str:
    """Time against error for each scene, both logarithmic, with the Pareto front of all points."""
    def panel(axes: Any, scene: Json) -> None:
        curves = points_of(scene)
        ours = networks(scene)
        for name, points in curves.items():
            if name in BASELINE_STYLES:
                colour, marker = BASELINE_STYLES[name]
                axes.plot([p.ms for p in points], [p.error for p in points], color=colour, marker=marker, markersize=4,
                          linewidth=1, label=name)
            else:
                colour = NETWORK_COLOURS[ours.index(name) % len(NETWORK_COLOURS)] if name in ours else "black"
                marker = {NONE: "x", SSGI: "^"}.get(name, "*")
                axes.plot(points[0].ms, points[0].error, color=colour, marker=marker, linestyle="",
                          markersize=7 if marker in "x^" else 12, label=name)
        front = pareto_front(p for points in curves.values() for p in points)
        axes.step([p.ms for p in front], [p.error for p in front], where="post", color="black", linewidth=3, alpha=0.18,
                  label="Pareto front")
        layer, metric = HEADLINE_ERROR
        axes.axhline(scene["ambient"]["errors"][layer][metric], color=GREY, linestyle=":", linewidth=1,
                     label="best constant ambient")
        axes.set(title=scene["name"], xlabel="ms per frame", ylabel=metric.upper())
        _logarithmic(axes)

    return _panels(results["scenes"], panel, (4.2, 3.6))


def stages(results: Json) -> str:
    """Stacked median times of each stage, for each scene at its largest size."""
    size = max((tuple(c["size"]) for s in results["scenes"] for c in s["configurations"]), key=math.prod)
    shown = {s["name"]: [c for c in s["configurations"] if tuple(c["size"]) == size] for s in results["scenes"]}
    fullest_first = sorted((c["stages"] for cs in shown.values() for c in cs), key=len, reverse=True)
    names = [n for n in dict.fromkeys(n for found in fullest_first for n in found) if n not in STAGES_LEFT_OUT]
    colours = _colours(names)

    def panel(axes: Any, scene: Json) -> None:
        entries = shown[scene["name"]][::-1]
        left = [0.0] * len(entries)
        for name in names:
            widths = [c["stages"].get(name, {"median": 0.0})["median"] for c in entries]
            axes.barh([c["label"] for c in entries], widths, left=left, color=colours[name], label=name)
            left = [a + b for a, b in zip(left, widths, strict=True)]
        axes.set(title=scene["name"], xlabel=f"ms at {size[0]}×{size[1]}")

    return _panels(results["scenes"], panel, (4.2, 2.6))


def growth(found: Json) -> str:
    """Each sweep with both axes logarithmic."""
    colours = _colours(list(dict.fromkeys(name for data in found.values() for name in data["stages"])))

    def panel(axes: Any, sweep: tuple[str, Json]) -> None:
        quantity, data = sweep
        for name, stage in data["stages"].items():
            if stage["exponent"] is not None:
                whole = name == FRAME
                axes.plot(data["counts"], stage["ms"], marker="o", markersize=3, linewidth=2.5 if whole else 1.2,
                          color="black" if whole else colours[name], label=name)
        axes.set(xlabel=quantity, ylabel="ms")
        _logarithmic(axes)

    return _panels(list(found.items()), panel, (4.2, 3.6))


def _colours(names: Sequence[str]) -> dict[str, Any]:
    palette = extra_module("matplotlib", "judge").colormaps["tab20"].colors
    return {name: palette[index % len(palette)] for index, name in enumerate(names)}


def _logarithmic(axes: Any) -> None:
    """Both axes, with a fine grid and plain numbers."""
    ticker = extra_module("matplotlib.ticker", "judge")
    axes.set(xscale="log", yscale="log")
    axes.grid(True, which="both", linewidth=0.3, alpha=0.5)
    for axis, steps in ((axes.xaxis, (1, 3)), (axes.yaxis, (1, 2, 5))):
        axis.set_major_locator(ticker.LogLocator(subs=steps))
        axis.set_major_formatter(ticker.FormatStrFormatter("%g"))
        axis.set_minor_formatter(ticker.NullFormatter())


def _panels(items: Sequence[Any], draw: Callable[[Any, Any], None], size: tuple[float, float]) -> str:
    """A grid of small charts, one for each item, under a legend of all their labels."""
    matplotlib = extra_module("matplotlib", "judge")
    figure_class = extra_module("matplotlib.figure", "judge").Figure
    columns = min(COLUMNS, len(items))
    lines = math.ceil(len(items) / columns)
    with matplotlib.rc_context({"svg.hashsalt": "afterglow", "svg.fonttype": "none", "font.size": 8}):
        figure = figure_class(figsize=(size[0] * columns, size[1] * lines + 0.7), layout="constrained")
        grid = figure.subplots(lines, columns, squeeze=False).flatten()
        for axes, item in zip(grid, items, strict=False):
            draw(axes, item)
        for axes in grid[len(items):]:
            axes.remove()
        found = [axes.get_legend_handles_labels() for axes in figure.axes]
        labels = {label: handle for handles, names in found for handle, label in zip(handles, names, strict=True)}
        figure.legend(labels.values(), labels.keys(), loc="outside upper center", ncols=2 * columns, frameon=False)
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    return svg[svg.index("<svg"):]
