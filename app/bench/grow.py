"""How cost grows: one quantity is swept, and each stage's time is fitted with a power of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from app.bench.configurations import Configuration, rescaled
from app.bench.exporter import run_export
from app.bench.hall import hall
from app.bench.measure import FRAME, Contender, Race

Json = dict[str, Any]
Progress = Callable[[str], None]

SIZES = ((256, 192), (512, 384), (1024, 768), (1448, 1086))
TRIANGLES = (1_000, 10_000, 100_000, 1_000_000)
LIGHTS = (1, 2, 4, 8, 16)
SCALES = (1 / 16, 1 / 8, 3 / 16, 1 / 4)
MIDDLE, WIDE = (512, 384), (768, 768)  # in the second the scale 1/16 is not raised
LEAST_MS = 0.1  # a stage that never takes longer is not fitted


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

    Surfels and width are fixed in a network's file: ``python -m export sized`` makes networks that differ in them.

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
    TruthError
        When the networks can't be made.
    """
    model = ([c for c in configurations if isinstance(c.file, Path)] or list(configurations))[-1]
    sweeps: dict[str, list[tuple[int, Contender]]] = {
        "pixels": [(w * h, _contender(replace(model, size=(w, h)))) for w, h in SIZES],
        "triangles": [(n, _contender(replace(model, size=MIDDLE), triangles=n)) for n in TRIANGLES],
        "lights": [(n, _contender(replace(model, size=MIDDLE), lights=n)) for n in LIGHTS],
    }
    if isinstance(model.file, Path):
        network = model.file
        at = [replace(model, size=WIDE, models=(rescaled(network, scale, folder),)) for scale in SCALES]
        sweeps["queries"] = [(int(np.prod(c.grid or (0,))), _contender(c)) for c in at]
    sized = folder / "sized"
    run_export(["sized", "--out", str(sized)], "networks of several sizes, which need pip install 'afterglow[export]'")
    for quantity in ("surfels", "width"):
        files = {int(file.stem.removeprefix(f"{quantity}-")): file for file in sized.glob(f"{quantity}-*.onnx")}
        sweeps[quantity] = [(n, _contender(Configuration(quantity, (files[n],), MIDDLE))) for n in sorted(files)]
    found = {}
    for name, points in sweeps.items():
        contenders = [contender for _, contender in points]
        with Race(contenders, provider) as race:
            for turn in range(turns):
                progress(f"growth with {name}, turn {turn + 1} of {turns}")
                race.turn()
        found[name] = _fitted([count for count, _ in points], contenders)
    return {"model": model.label, "sweeps": found}


def _contender(configuration: Configuration, triangles: int = 10_000, lights: int = 1) -> Contender:
    scene = hall(triangles, lights)
    return Contender(scene, scene.cameras[scene.default_camera].at(0.0), configuration)


def _fitted(counts: list[int], contenders: list[Contender]) -> Json:
    stages = {}
    for name in contenders[0].stages:
        ms = [c.stages[name].median for c in contenders]
        fit = fit_power(counts, ms) if max(ms) >= LEAST_MS else None
        stages[name] = {"ms": [round(v, 4) for v in ms], "exponent": fit and round(fit.exponent, 3),
                        "error": fit and round(fit.error, 3)}
    stages[FRAME] = stages.pop(FRAME)
    return {"counts": counts, "stages": stages}
