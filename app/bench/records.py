"""What was measured, as the JSON file holds it."""

from __future__ import annotations

import math
from typing import Any

from app.bench.judge import Errors, errors_of
from app.bench.measure import Contender, Spread
from app.bench.rivals import NAMES, Rivals
from app.bench.truth import Truth

Json = dict[str, Any]


def contender(measured: Contender) -> Json:
    """A configuration with its times; ``errors`` and ``fresh`` are filled in where they were measured."""
    c = measured.configuration
    return {"label": c.label, "size": list(c.size), "grid": c.grid and list(c.grid), "precision": c.precision,
            "device": measured.device, "stages": {name: _spread(s) for name, s in measured.stages.items()},
            "errors": None, "fresh": None}


def rivals(opponents: Rivals, truth: Truth) -> list[Json]:
    """The path tracer's pictures, bare and denoised, each by rising sample count."""
    def order(key: tuple[str, int]) -> tuple[int, int]:
        return NAMES.index(key[0]), key[1]

    times = opponents.times()
    return [{"name": name, "spp": spp, "ms": _spread(times[name, spp]),
             "errors": errors(errors_of({"final": opponents.pictures[name, spp]}, truth))}
            for name, spp in sorted(times, key=order)]


def truth(found: Truth) -> Json:
    """Size, key, and what the path tracer says about its samples and noise."""
    about: Json = {key: found.about[key] for key in ("spp", "seconds", "paths_per_second") if key in found.about}
    noise = {name: _finite(float(value)) for name, value in found.about.get("noise", {}).items()}
    return {**about, "noise": noise, "size": list(found.size), "key": found.key}


def errors(found: dict[str, Errors]) -> Json:
    """By layer and metric."""
    return {layer: {metric: _finite(value) for metric, value in values.items()} for layer, values in found.items()}


def _spread(found: Spread) -> Json:
    return {"median": round(found.median, 4), "p95": round(found.p95, 4),
            "turns": [round(ms, 4) for ms in found.turns]}


def _finite(value: float) -> float | None:
    """What JSON can hold: None for the infinite PSNR of equal images."""
    return value if math.isfinite(value) else None
