"""The report's figures as SVG text that needs no fonts or other files."""

import io
import math
from collections.abc import Callable, Sequence
from typing import Any

from app.bench.baselines import NAMES
from app.bench.headlines import HEADLINE_ERROR, networks_of, points_of
from app.bench.pareto import pareto_front
from app.bench.records import Json
from app.evaluation.timing import FRAME, YARDSTICK
from app.extras import extra_module
from app.network.selection import NONE, SSGI

COLUMNS = 3
BASELINE_STYLES = dict(zip(NAMES, (("#999999", "o"), ("#6aa2d8", "s"), ("#2f6db3", "D")), strict=True))
NETWORK_COLORS = ("#d1495b", "#e8963e", "#7b4fa3", "#2a9d8f", "#8a6d3b", "#c46bae", "#7a9e2f", "#1f4e79")


def plot_errors(results: Json) -> str:
    """Time against error of each scene, both logarithmic, with the Pareto front of all points."""
    def panel(axes: Any, scene: Json) -> None:
        curves, networks = points_of(scene), networks_of(scene)
        for name, points in curves.items():
            if name in BASELINE_STYLES:
                color, marker = BASELINE_STYLES[name]
                axes.plot(*zip(*points, strict=True), color=color, marker=marker, markersize=4, linewidth=1, label=name)
            else:
                color = NETWORK_COLORS[networks.index(name) % len(NETWORK_COLORS)] if name in networks else "black"
                marker = {NONE: "x", SSGI: "^"}.get(name, "*")
                axes.plot(*points[0], color=color, marker=marker, linestyle="",
                          markersize=7 if marker in "x^" else 12, label=name)
        pareto = pareto_front(p for points in curves.values() for p in points)
        axes.step(*zip(*pareto, strict=True), where="post", color="black", linewidth=3, alpha=0.18,
                  label="Pareto front")
        layer, metric = HEADLINE_ERROR
        axes.axhline(scene["ambient"]["errors"][layer][metric], color="#555555", linestyle=":",
                     linewidth=1, label="best constant ambient")
        axes.set(title=scene["name"], xlabel="ms per frame", ylabel=metric.upper())
        _logarithmic(axes)

    return _panels(results["scenes"], panel)


def plot_stages(results: Json) -> str:
    """Stacked median times of all stages, for each scene at its largest size."""
    size = max((tuple(c["size"]) for s in results["scenes"] for c in s["configurations"]), key=math.prod)
    largest = {s["name"]: [c for c in s["configurations"] if tuple(c["size"]) == size] for s in results["scenes"]}
    longest_first = sorted((c["stages"] for cs in largest.values() for c in cs), key=len, reverse=True)
    names = [n for n in dict.fromkeys(n for stages in longest_first for n in stages) if n not in (FRAME, YARDSTICK)]
    colors = _colors(names)

    def panel(axes: Any, scene: Json) -> None:
        entries = largest[scene["name"]][::-1]
        left = [0.0] * len(entries)
        for name in names:
            widths = [c["stages"].get(name, {"median": 0.0})["median"] for c in entries]
            axes.barh([c["label"] for c in entries], widths, left=left, color=colors[name], label=name)
            left = [a + b for a, b in zip(left, widths, strict=True)]
        axes.set(title=scene["name"], xlabel=f"ms at {size[0]}×{size[1]}")

    return _panels(results["scenes"], panel, height=2.6)


def plot_scaling(sweeps: Json) -> str:
    """Stage times of each sweep, both axes logarithmic."""
    colors = _colors(list(dict.fromkeys(name for data in sweeps.values() for name in data["stages"])))

    def panel(axes: Any, sweep: tuple[str, Json]) -> None:
        quantity, data = sweep
        for name, stage in data["stages"].items():
            if stage["exponent"] is not None:
                whole = name == FRAME
                axes.plot(data["counts"], stage["ms"], marker="o", markersize=3, linewidth=2.5 if whole else 1.2,
                          color="black" if whole else colors[name], label=name)
        axes.set(xlabel=quantity, ylabel="ms")
        _logarithmic(axes)

    return _panels(list(sweeps.items()), panel)


def _colors(names: Sequence[str]) -> dict[str, Any]:
    palette = extra_module("matplotlib", "evaluation").colormaps["tab20"].colors
    return {name: palette[index % len(palette)] for index, name in enumerate(names)}


def _logarithmic(axes: Any) -> None:
    """Make both axes logarithmic, with a fine grid and plain numbers."""
    ticker = extra_module("matplotlib.ticker", "evaluation")
    axes.set(xscale="log", yscale="log")
    axes.grid(True, which="both", linewidth=0.3, alpha=0.5)
    for axis, steps in ((axes.xaxis, (1, 3)), (axes.yaxis, (1, 2, 5))):
        axis.set_major_locator(ticker.LogLocator(subs=steps))
        axis.set_major_formatter(ticker.FormatStrFormatter("%g"))
        axis.set_minor_formatter(ticker.NullFormatter())


def _panels(items: Sequence[Any], draw: Callable[[Any, Any], None], height: float = 3.6) -> str:
    """A grid of small charts of ``height`` inches, one per item, under one legend for all of them."""
    matplotlib = extra_module("matplotlib", "evaluation")
    figure_class = extra_module("matplotlib.figure", "evaluation").Figure
    columns = min(COLUMNS, len(items))
    lines = math.ceil(len(items) / columns)
    with matplotlib.rc_context({"svg.hashsalt": "afterglow", "svg.fonttype": "none", "font.size": 8}):
        figure = figure_class(figsize=(4.2 * columns, height * lines + 0.7), layout="constrained")
        grid = figure.subplots(lines, columns, squeeze=False).flatten()
        for axes, item in zip(grid, items, strict=False):
            draw(axes, item)
        for axes in grid[len(items):]:
            axes.remove()
        legends = [axes.get_legend_handles_labels() for axes in figure.axes]
        labels = {label: handle for handles, names in legends for handle, label in zip(handles, names, strict=True)}
        figure.legend(labels.values(), labels.keys(), loc="outside upper center", ncols=2 * columns, frameon=False)
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    return svg[svg.index("<svg"):]
