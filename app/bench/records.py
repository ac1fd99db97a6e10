"""Measurements in the form that the JSON file holds, and as flat rows for the CSV file and the terminal."""

import math
from collections.abc import Iterator
from typing import Any

from app.bench.baselines import Baseline
from app.evaluation.picture_errors import AMBIENT, Errors, errors_of
from app.evaluation.reference import Reference
from app.evaluation.timing import Spread, TimedRun
from app.network.selection import NONE

Json = dict[str, Any]
Row = dict[str, object]


def run_record(run: TimedRun) -> Json:
    """A configuration with its times; ``errors`` and ``cold_start`` are filled in where they are measured."""
    c = run.configuration
    return {"label": c.label, "size": list(c.size), "grid": c.grid and list(c.grid), "precision": c.precision,
            "device": run.device, "stages": {name: spread_record(s) for name, s in run.stages.items()},
            "errors": None, "cold_start": None}


def baseline_record(baseline: Baseline, reference: Reference) -> Json:
    """One of the path tracer's pictures, raw or denoised, with its errors."""
    return {"name": baseline.name, "spp": baseline.spp, "ms": round(baseline.ms, 4),
            "errors": error_record(errors_of({"final": baseline.picture}, reference))}


def reference_record(reference: Reference) -> Json:
    """Size, key, and what the path tracer reports about samples, noise and features that it did not draw."""
    about: Json = {key: reference.about[key] for key in ("spp", "seconds", "paths_per_second")
                   if key in reference.about}
    noise = {name: _finite(float(value)) for name, value in reference.about.get("noise", {}).items()}
    return {**about, "noise": noise, "notices": reference.about.get("notices", []), "size": list(reference.size),
            "key": reference.key}


def error_record(errors: dict[str, Errors]) -> Json:
    """Errors by layer and metric."""
    return {layer: {metric: _finite(value) for metric, value in values.items()} for layer, values in errors.items()}


def spread_record(spread: Spread) -> Json:
    """Milliseconds."""
    return {"median": round(spread.median, 4), "p95": round(spread.p95, 4),
            "rounds": [round(ms, 4) for ms in spread.rounds]}


def rows(results: Json) -> Iterator[Row]:
    """One row per configuration, baseline and oracle of each scene; times in milliseconds.

    The time of a baseline is a single measurement, which has no percentiles.
    """
    for scene in results["scenes"]:
        for c in scene["configurations"]:
            row: Row = {"scene": scene["name"], "kind": "none" if c["label"] == NONE else "renderer",
                        "label": c["label"], "size": _format_size(c["size"]),
                        "grid": c["grid"] and _format_size(c["grid"]), "precision": c["precision"],
                        "provider": c["device"]["provider"], "gl_renderer": c["device"]["gl_renderer"],
                        **(c["cold_start"] or {}), **_flat_errors(c["errors"])}
            for stage, spread in c["stages"].items():
                row |= {f"{stage}.median_ms": spread["median"], f"{stage}.p95_ms": spread["p95"]}
            yield row
        size = _format_size(scene["reference"]["size"])
        yield {"scene": scene["name"], "kind": "oracle", "label": AMBIENT, "size": size,
               **_flat_errors(scene["ambient"]["errors"])}
        for b in scene["baselines"]:
            yield {"scene": scene["name"], "kind": "baseline", "label": b["name"], "size": size, "spp": b["spp"],
                   "frame.median_ms": b["ms"], **_flat_errors(b["errors"])}


def _finite(value: float) -> float | None:
    """None, which JSON can hold, for the infinite PSNR of equal images."""
    return value if math.isfinite(value) else None


def _flat_errors(errors: Json | None) -> Row:
    return {f"{layer}.{metric}": value for layer, values in (errors or {}).items() for metric, value in values.items()}


def _format_size(size: list[int]) -> str:
    return f"{size[0]}x{size[1]}"
