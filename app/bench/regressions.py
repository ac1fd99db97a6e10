"""Comparison of two runs: what became slower or less accurate beyond noise."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app.bench.records import Json
from app.bench.run import VERSION
from app.errors import SettingsError
from app.evaluation.metrics import METRICS
from app.evaluation.timing import FRAME, YARDSTICK
from app.extras import extra_module

MIN_MS = 0.05            # shorter stages are not compared
MIN_ROUNDS = 5
RUN_TO_RUN_NOISE = 0.03  # relative difference between times of equal programs
SIGNIFICANCE = 0.05      # probability that a comparison of equal programs reports any time at all
MAX_QUIET_DRIFT = 0.1    # larger drifts are noted
PICTURE_KEYS = ("lighting", "camera", "triangles", "lights")


@dataclass(frozen=True)
class Change:
    """A figure that moved by more than ``noise``, which has the same unit."""

    where: str
    figure: str
    old: float
    new: float
    noise: float
    worse: bool

    def __str__(self) -> str:
        return (f"{'worse' if self.worse else 'better'}: {self.where}, {self.figure} {self.old:.4g} -> {self.new:.4g} "
                f"(noise {self.noise:.2g})")


class _Times(NamedTuple):
    """A stage's times in both runs."""

    where: str
    stage: str
    old: Json
    new: Json
    drift: float


def read_results(path: Path) -> Json:
    """Read the JSON file of an earlier run.

    Raises
    ------
    SettingsError
        When it is not one of this version.
    """
    try:
        value: Json = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise SettingsError(f"can't read {path}: {error}", "--compare", "expected the bench.json of a run") from None
    try:
        valid = value["version"] == VERSION
        compare(value, value)  # reads every key that a comparison needs
    except (KeyError, TypeError, AttributeError, ValueError):
        valid = False
    if not valid:
        raise SettingsError(f"{path} is not a result of version {VERSION}", "--compare",
                            "expected the bench.json of a run")
    return value


def compare(old: Json, new: Json) -> tuple[list[Change], list[str]]:
    """Changes beyond noise, and notes on what could not be compared.

    A time has changed if its median moved by more than 3 % plus the share by which the yardsticks moved, which no
    change of the program affects, and Welch's t-test on the rounds of both runs is significant at 5 % over all times
    together (Bonferroni). Errors have no noise; for them the bound is what is noticeable.
    """
    changes: list[Change] = []
    times: list[_Times] = []
    same_machine = all(old["machine"][key] == new["machine"][key] for key in ("processor", "cores"))
    notes = _load_notes(old, "the earlier run") + _load_notes(new, "this run")
    if not same_machine:
        notes.append("another machine: times are not compared")
    for name, a, b in _matched(_scenes(old), _scenes(new), notes):
        differing = [key for key in PICTURE_KEYS if a[key] != b[key]]
        if differing:
            notes.append(f"{name} differs in {' and '.join(differing)}: it is not compared")
            continue
        same_reference = a["reference"]["key"] == b["reference"]["key"]
        if not same_reference:
            notes.append(f"{name} has another reference: its errors are not compared")
        drift = _drift(a, b)
        if same_machine and drift > MAX_QUIET_DRIFT:
            notes.append(f"{name}: the yardsticks moved by {drift:.0%}, so smaller changes do not show")
        for where, c, d in _matched(_configurations(a), _configurations(b), notes):
            if same_reference:
                changes += _error_changes(where, c["errors"] or {}, d["errors"] or {})
            if _device(c) != _device(d):
                notes.append(f"times on {_device(d)} are not compared with times on {_device(c)}")
            elif min(len(x["stages"][FRAME]["rounds"]) for x in (c, d)) < MIN_ROUNDS:
                notes.append(f"times of fewer than {MIN_ROUNDS} rounds are not compared")
            elif same_machine:
                matched = _matched(_stages(where, c), _stages(where, d), notes)
                times += [_Times(where, stage.removeprefix(f"{where}, "), x, y, drift) for stage, x, y in matched
                          if max(x["median"], y["median"]) >= MIN_MS]
    return [*_time_changes(times), *changes], list(dict.fromkeys(notes))


def _matched(old: dict[str, Json], new: dict[str, Json], notes: list[str]) -> list[tuple[str, Json, Json]]:
    """Entries that both runs have; those that only one has are noted."""
    notes += [f"{name} is gone" for name in old if name not in new]
    notes += [f"{name} is new" for name in new if name not in old]
    return [(name, old[name], new[name]) for name in new if name in old]


def _scenes(results: Json) -> dict[str, Json]:
    return {scene["name"]: scene for scene in results["scenes"]}


def _configurations(scene: Json) -> dict[str, Json]:
    return {f"{scene['name']}, {c['label']} at {c['size'][0]}x{c['size'][1]}": c for c in scene["configurations"]}


def _stages(where: str, configuration: Json) -> dict[str, Json]:
    return {f"{where}, {name}": times for name, times in configuration["stages"].items() if name != YARDSTICK}


def _time_changes(times: Sequence[_Times]) -> Iterator[Change]:
    for where, stage, old, new, drift in times:
        a, b = old["median"], new["median"]
        noise = (RUN_TO_RUN_NOISE + drift) * a
        if abs(b - a) > noise and _p_value(old["rounds"], new["rounds"]) < SIGNIFICANCE / len(times):
            yield Change(where, f"{stage} ms", a, b, noise, b > a)


def _p_value(old: Sequence[float], new: Sequence[float]) -> float:
    """Welch's t-test on the logarithms of both runs' rounds, two-sided."""
    a, b = (np.log(np.maximum(ms, 1e-6)) for ms in (old, new))
    return float(extra_module("scipy.stats", "evaluation").ttest_ind(a, b, equal_var=False).pvalue)


def _error_changes(where: str, old: Json, new: Json) -> Iterator[Change]:
    for layer in new:  # equal programs draw equal bits, so errors have no noise
        for name, b in new[layer].items():
            a, metric = old.get(layer, {}).get(name), METRICS[name]
            if a is None or b is None:  # the infinite PSNR of equal images
                continue
            noise = metric.noticeable * (abs(a) if metric.relative else 1.0)
            if abs(b - a) > noise:
                yield Change(where, f"{layer} {name}", a, b, noise, (b < a) == metric.higher_is_better)


def _drift(old: Json, new: Json) -> float:
    """Relative change, up or down, of the copy or of the matrix product, whichever changed more."""
    earlier = _configurations(old)
    copies = [_relative_change(earlier[where]["stages"][YARDSTICK], c["stages"][YARDSTICK])
              for where, c in _configurations(new).items() if where in earlier]
    product = _relative_change(old["yardstick"], new["yardstick"])
    return max(abs(float(np.median(copies))) if copies else 0.0, abs(product))


def _relative_change(old: Json, new: Json) -> float:
    return float(new["median"] / max(old["median"], 1e-9) - 1)


def _device(configuration: Json) -> str:
    device = configuration["device"]
    return f"{device['gl_renderer']} with provider {device['provider']}"


def _load_notes(results: Json, run: str) -> list[str]:
    load, cores = results["machine"]["load_average"], results["machine"]["cores"]
    if load <= cores:
        return []
    return [f"{run} began under a load of {load:.1f} on {cores} cores, so its times are unreliable"]
