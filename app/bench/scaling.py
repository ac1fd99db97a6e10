"""How cost grows: one quantity is swept, and each stage's time is fitted with a power of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from app.bench.scaling_scene import hall
from app.evaluation.configurations import Configuration, rescaled
from app.evaluation.timing import FRAME, InterleavedTimer, TimedRun
from app.io.child_process import run_export

Json = dict[str, Any]
Progress = Callable[[str], None]

SIZES = ((256, 192), (512, 384), (1024, 768), (1448, 1086))
TRIANGLES = (1_000, 10_000, 100_000, 1_000_000)
LIGHTS = (1, 2, 4, 8, 16)
SCALES = (1 / 16, 1 / 8, 3 / 16, 1 / 4)
MIDDLE, WIDE = (512, 384), (768, 768)  # in the second the scale 1/16 is not raised
MIN_MS = 0.1  # a stage that never takes longer is not fitted


@dataclass(frozen=True)
class Fit:
    """time ∝ count ** ``exponent``; ``error`` is the exponent's standard error."""

    exponent: float
    error: float


def fit_power(counts: Sequence[float], times: Sequence[float]) -> Fit:
    """Least squares of log(time) over log(count)."""
    x, y = np.log(np.asarray(counts, np.float64)), np.log(np.maximum(times, 1e-9))
    slope, offset = np.polyfit(x, y, 1)
    rest = y - slope * x - offset
    degrees = len(x) - 2
    error = np.sqrt((rest @ rest) / degrees / ((x - x.mean()) ** 2).sum()) if degrees > 0 else 0.0
    return Fit(float(slope), float(error))


def grow(configurations: Sequence[Configuration], turns: int, provider: str, folder: Path,
         progress: Progress = lambda _: None) -> Json:
    """Sweep pixels, triangles, lights, the network's queries, surfels and network width in a generated hall.

    Surfels and width are fixed in a network's file: ``python -m export onnx scaling`` makes networks that differ in them.

    Parameters
    ----------
    configurations : sequence of Configuration
        The network of the last one that draws with one alone is used, or else the last one.
    folder : Path
        For networks of other scales and sizes.

    Returns
    -------
    dict
        ``model``; and ``sweeps`` by quantity: ``counts``, and ``stages`` with ``ms`` for each count, ``exponent`` and
        its standard ``error``.

    Raises
    ------
    PathTracerError
        When the networks can't be made.
    """
    model = ([c for c in configurations if isinstance(c.file, Path)] or list(configurations))[-1]
    sweeps: dict[str, list[tuple[int, TimedRun]]] = {
        "pixels": [(w * h, _timed_run(replace(model, size=(w, h)))) for w, h in SIZES],
        "triangles": [(n, _timed_run(replace(model, size=MIDDLE), triangles=n)) for n in TRIANGLES],
        "lights": [(n, _timed_run(replace(model, size=MIDDLE), lights=n)) for n in LIGHTS],
    }
    if isinstance(model.file, Path):
        network = model.file
        at = [replace(model, size=WIDE, models=(rescaled(network, scale, folder),)) for scale in SCALES]
        sweeps["queries"] = [(int(np.prod(c.grid or (0,))), _timed_run(c)) for c in at]
    sized = folder / "sized"
    run_export(["onnx", "scaling", "--out", str(sized)], "networks of several sizes, which need pip install 'afterglow[export]'")
    for quantity in ("surfels", "width"):
        files = {int(file.stem.removeprefix(f"{quantity}-")): file for file in sized.glob(f"{quantity}-*.onnx")}
        sweeps[quantity] = [(n, _timed_run(Configuration(quantity, (files[n],), MIDDLE))) for n in sorted(files)]
    found = {}
    for name, points in sweeps.items():
        timed_runs = [timed_run for _, timed_run in points]
        with InterleavedTimer(timed_runs, provider) as timer:
            for turn in range(turns):
                progress(f"growth with {name}, turn {turn + 1} of {turns}")
                timer.turn()
        found[name] = _fitted([count for count, _ in points], timed_runs)
    return {"model": model.label, "sweeps": found}


def _timed_run(configuration: Configuration, triangles: int = 10_000, lights: int = 1) -> TimedRun:
    scene = hall(triangles, lights)
    return TimedRun(scene, scene.cameras[scene.default_camera].at(0.0), configuration)


def _fitted(counts: list[int], timed_runs: list[TimedRun]) -> Json:
    stages = {}
    for name in timed_runs[0].stages:
        ms = [c.stages[name].median for c in timed_runs]
        fit = fit_power(counts, ms) if max(ms) >= MIN_MS else None
        stages[name] = {"ms": [round(v, 4) for v in ms], "exponent": fit and round(fit.exponent, 3),
                        "error": fit and round(fit.error, 3)}
    stages[FRAME] = stages.pop(FRAME)
    return {"counts": counts, "stages": stages}
