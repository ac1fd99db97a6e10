"""What became slower or worse since another run, beyond noise."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from app.bench.judge import HIGHER_IS_BETTER
from app.bench.measure import YARDSTICK
from app.bench.run import VERSION
from app.errors import SettingsError

Json = dict[str, Any]

LEAST_MS = 0.05          # shorter stages are left out
NOTABLE_DRIFT = 0.1
# Equal frames give equal bits, so that errors have no noise of their own; these are what no one would notice.
NOTICEABLE = {"flip": 0.01, "rel_mse": 0.01, "psnr": 0.05, "ssim": 0.001}
RELATIVE = ("flip", "rel_mse")


@dataclass(frozen=True)
class Change:
    """A figure that moved further than ``noise``, in the same unit."""

    where: str
    figure: str
    old: float
    new: float
    noise: float
    worse: bool

    def __str__(self) -> str:
        return (f"{'worse' if self.worse else 'better'}: {self.where}, {self.figure} {self.old:.4g} -> {self.new:.4g} "
                f"(noise {self.noise:.2g})")


def read_results(path: Path) -> Json:
    """The JSON file of an earlier run.

    Raises
    ------
    SettingsError
        When it is none.
    """
    try:
        value = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise SettingsError(f"can't read {path} ({error})", "--compare", "expected the bench.json of a run") from None
    if not isinstance(value, dict) or value.get("version") != VERSION:
        raise SettingsError(f"{path} is no result of this version", "--compare", "expected the bench.json of a run")
    return value


def compare(old: Json, new: Json) -> tuple[list[Change], list[str]]:
    """Changes beyond noise, and notes on what could not be compared.

    A time's noise is the interquartile ranges of both runs' turns, added (with five turns or more about four standard
    errors of the difference), and as much as the yardstick has moved, since no change of the program moves that.
    Errors have no noise, so for them it is what no one would notice.
    """
    changes: list[Change] = []
    notes: list[str] = []
    timed = _same_machine(old, new)
    if not timed:
        notes.append("another machine or GL renderer: times are not compared")
    before = {scene["name"]: scene for scene in old["scenes"]}
    for scene in new["scenes"]:
        if scene["name"] not in before:
            notes.append(f"{scene['name']} is new")
            continue
        earlier = before[scene["name"]]
        if earlier["truth"]["key"] != scene["truth"]["key"]:
            notes.append(f"{scene['name']} has another truth: its errors may differ by the truths' noise")
        known = {(c["label"], *c["size"]): c for c in earlier["configurations"]}
        drift = _drift(known, scene["configurations"])
        if timed and drift > NOTABLE_DRIFT:
            notes.append(f"{scene['name']}: a plain copy takes {drift:.0%} more or less time than before, so smaller "
                         "changes don't show")
        for c in scene["configurations"]:
            match = known.get((c["label"], *c["size"]))
            where = f"{scene['name']}, {c['label']} at {c['size'][0]}x{c['size'][1]}"
            if match is None:
                notes.append(f"{where} is new")
                continue
            if timed:
                changes += _slower(where, match["stages"], c["stages"], drift)
            changes += _farther(where, match["errors"] or {}, c["errors"] or {})
    return changes, notes


def _slower(where: str, old: Json, new: Json, drift: float) -> Iterator[Change]:
    for stage in new:
        if stage in old and stage != YARDSTICK and max(old[stage]["median"], new[stage]["median"]) >= LEAST_MS:
            a, b = old[stage]["median"], new[stage]["median"]
            noise = _spread(old[stage]["turns"]) + _spread(new[stage]["turns"]) + drift * a
            if abs(b - a) > noise:
                yield Change(where, f"{stage} ms", a, b, noise, b > a)


def _farther(where: str, old: Json, new: Json) -> Iterator[Change]:
    for layer in new:
        for metric, b in new[layer].items():
            a = old.get(layer, {}).get(metric)
            if a is None or b is None:  # the infinite PSNR of equal images
                continue
            noise = NOTICEABLE[metric] * (abs(a) if metric in RELATIVE else 1.0)
            if abs(b - a) > noise:
                yield Change(where, f"{layer} {metric}", a, b, noise, (b < a) == (metric in HIGHER_IS_BETTER))


def _drift(known: dict[tuple[object, ...], Json], new: list[Json]) -> float:
    """By which share the yardstick's time has changed, up or down; the median over all configurations."""
    ratios = [c["stages"][YARDSTICK]["median"] / max(match["stages"][YARDSTICK]["median"], 1e-9)
              for c in new if (match := known.get((c["label"], *c["size"]))) is not None]
    return abs(float(np.median(ratios)) - 1) if ratios else 0.0


def _spread(turns: list[float]) -> float:
    """Interquartile range."""
    return float(np.subtract(*np.percentile(turns, [75, 25])))


def _same_machine(old: Json, new: Json) -> bool:
    def of(results: Json) -> tuple[object, ...]:
        renderers = {c["device"]["gl_renderer"] for s in results["scenes"] for c in s["configurations"]}
        return results["machine"]["processor"], results["machine"]["cores"], tuple(sorted(renderers))

    return of(old) == of(new)
