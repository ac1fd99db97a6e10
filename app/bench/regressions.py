"""What became slower or worse since another run, beyond noise."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from app.bench.run import VERSION
from app.errors import SettingsError
from app.evaluation.picture_errors import HIGHER_IS_BETTER
from app.evaluation.timing import FRAME, YARDSTICK
from app.extras import extra_module

Json = dict[str, Any]

MIN_MS = 0.05          # shorter stages are left out
MIN_TURNS = 5
FLOOR = 0.03             # by which times of equal programs differ from run to run
SIGNIFICANCE = 0.05      # chance that a comparison of equal programs names any time at all
NOTABLE_DRIFT = 0.1
PICTURE = ("lighting", "camera", "triangles", "lights")
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


class _Times(NamedTuple):
    """A stage's times in both runs."""

    where: str
    stage: str
    old: Json
    new: Json
    drift: float


def read_results(path: Path) -> Json:
    """The JSON file of an earlier run.

    Raises
    ------
    SettingsError
        When it is none.
    """
    try:
        value: Json = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise SettingsError(f"can't read {path} ({error})", "--compare", "expected the bench.json of a run") from None
    try:
        whole = value["version"] == VERSION
        compare(value, value)  # looks at everything that a comparison needs
    except (KeyError, TypeError, AttributeError, ValueError):
        whole = False
    if not whole:
        raise SettingsError(f"{path} is no result of this version", "--compare", "expected the bench.json of a run")
    return value


def compare(old: Json, new: Json) -> tuple[list[Change], list[str]]:
    """Changes beyond noise, and notes on what could not be compared.

    A time has changed when its median moved by more than 3 % and the share by which the yardsticks moved, since no
    change of the program moves those, and Welch's t-test tells both runs' turns apart at 5 % over all times together
    (Bonferroni). Errors have no noise, so for them it is what no one would notice.
    """
    changes: list[Change] = []
    times: list[_Times] = []
    timed = _same_machine(old, new)
    notes = _load(old, "the earlier run") + _load(new, "this run")
    if not timed:
        notes.append("another machine: times are not compared")
    for name, a, b in _matched(_scenes(old), _scenes(new), notes):
        other = [key for key in PICTURE if a[key] != b[key]]
        if other:
            notes.append(f"{name} has other {' and '.join(other)}: it is not compared")
            continue
        judged = a["reference"]["key"] == b["reference"]["key"]
        if not judged:
            notes.append(f"{name} has another reference: its errors are not compared")
        drift = _drift(a, b)
        if timed and drift > NOTABLE_DRIFT:
            notes.append(f"{name}: the yardsticks moved by {drift:.0%}, so smaller changes don't show")
        for where, c, d in _matched(_configurations(a), _configurations(b), notes):
            if judged:
                changes += _farther(where, c["errors"] or {}, d["errors"] or {})
            if _device(c) != _device(d):
                notes.append(f"times on {_device(d)} are not compared with times on {_device(c)}")
            elif min(len(x["stages"][FRAME]["turns"]) for x in (c, d)) < MIN_TURNS:
                notes.append(f"times of fewer than {MIN_TURNS} turns are not compared")
            elif timed:
                found = _matched(_stages(where, c), _stages(where, d), notes)
                times += [_Times(where, stage.removeprefix(f"{where}, "), x, y, drift) for stage, x, y in found
                          if max(x["median"], y["median"]) >= MIN_MS]
    return [*_slower(times), *changes], list(dict.fromkeys(notes))


def _matched(old: dict[str, Json], new: dict[str, Json], notes: list[str]) -> list[tuple[str, Json, Json]]:
    """What both have; what only one of them has is noted."""
    notes += [f"{name} is gone" for name in old if name not in new]
    notes += [f"{name} is new" for name in new if name not in old]
    return [(name, old[name], new[name]) for name in new if name in old]


def _scenes(results: Json) -> dict[str, Json]:
    return {scene["name"]: scene for scene in results["scenes"]}


def _configurations(scene: Json) -> dict[str, Json]:
    return {f"{scene['name']}, {c['label']} at {c['size'][0]}x{c['size'][1]}": c for c in scene["configurations"]}


def _stages(where: str, configuration: Json) -> dict[str, Json]:
    return {f"{where}, {name}": times for name, times in configuration["stages"].items() if name != YARDSTICK}


def _slower(times: Sequence[_Times]) -> Iterator[Change]:
    for where, stage, old, new, drift in times:
        a, b = old["median"], new["median"]
        noise = (FLOOR + drift) * a
        if abs(b - a) > noise and _chance(old["turns"], new["turns"]) < SIGNIFICANCE / len(times):
            yield Change(where, f"{stage} ms", a, b, noise, b > a)


def _chance(old: Sequence[float], new: Sequence[float]) -> float:
    """Of such unlike turns where nothing changed; Welch's t-test on logarithms, two-sided."""
    a, b = (np.log(np.maximum(turns, 1e-6)) for turns in (old, new))
    return float(extra_module("scipy.stats", "judge").ttest_ind(a, b, equal_var=False).pvalue)


def _farther(where: str, old: Json, new: Json) -> Iterator[Change]:
    for layer in new:
        for metric, b in new[layer].items():
            a = old.get(layer, {}).get(metric)
            if a is None or b is None:  # the infinite PSNR of equal images
                continue
            noise = NOTICEABLE[metric] * (abs(a) if metric in RELATIVE else 1.0)
            if abs(b - a) > noise:
                yield Change(where, f"{layer} {metric}", a, b, noise, (b < a) == (metric in HIGHER_IS_BETTER))


def _drift(old: Json, new: Json) -> float:
    """By which share the yardsticks have moved, up or down: the copy or the product, whichever more."""
    known = _configurations(old)
    copies = [_moved(known[where]["stages"][YARDSTICK], c["stages"][YARDSTICK])
              for where, c in _configurations(new).items() if where in known]
    return max(abs(float(np.median(copies))) if copies else 0.0, abs(_moved(old["yardstick"], new["yardstick"])))


def _moved(old: Json, new: Json) -> float:
    return float(new["median"] / max(old["median"], 1e-9) - 1)


def _device(configuration: Json) -> str:
    device = configuration["device"]
    return f"{device['gl_renderer']} with provider {device['provider']}"


def _same_machine(old: Json, new: Json) -> bool:
    return all(old["machine"][key] == new["machine"][key] for key in ("processor", "cores"))


def _load(results: Json, run: str) -> list[str]:
    load, cores = results["machine"]["load_average"], results["machine"]["cores"]
    return [f"{run} began under a load of {load:.1f} on {cores} cores, so its times say little"] if load > cores else []
