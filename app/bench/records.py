"""What was measured, as the JSON file holds it."""

from __future__ import annotations

import math
from typing import Any

from app.bench.baselines import Baseline
from app.evaluation.picture_errors import Errors, errors_of
from app.evaluation.reference import Reference
from app.evaluation.timing import Spread, TimedRun

Json = dict[str, Any]


def timed_run(measured: TimedRun) -> Json:
    """A configuration with its times; ``errors`` and ``fresh`` are filled in where they were measured."""
    c = measured.configuration
    return {"label": c.label, "size": list(c.size), "grid": c.grid and list(c.grid), "precision": c.precision,
            "device": measured.device, "stages": {name: spread(s) for name, s in measured.stages.items()},
            "errors": None, "fresh": None}


def baseline(found: Baseline, reference: Reference) -> Json:
    """One of the path tracer's pictures, bare or denoised."""
    return {"name": found.name, "spp": found.spp, "ms": round(found.ms, 4),
            "errors": errors(errors_of({"final": found.picture}, reference))}


def reference(found: Reference) -> Json:
    """Size, key, and what the path tracer says about its samples, its noise and what it did not draw."""
    about: Json = {key: found.about[key] for key in ("spp", "seconds", "paths_per_second") if key in found.about}
    noise = {name: _finite(float(value)) for name, value in found.about.get("noise", {}).items()}
    return {**about, "noise": noise, "notices": found.about.get("notices", []), "size": list(found.size),
            "key": found.key}


def errors(found: dict[str, Errors]) -> Json:
    """By layer and metric."""
    return {layer: {metric: _finite(value) for metric, value in values.items()} for layer, values in found.items()}


def spread(found: Spread) -> Json:
    """Milliseconds."""
    return {"median": round(found.median, 4), "p95": round(found.p95, 4),
            "turns": [round(ms, 4) for ms in found.turns]}


def _finite(value: float) -> float | None:
    """What JSON can hold: None for the infinite PSNR of equal images."""
    return value if math.isfinite(value) else None
