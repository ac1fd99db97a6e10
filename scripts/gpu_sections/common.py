"""Options, timing and inputs that the sections share."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from app.arrays import F32
from app.exchange.copy import CopyExchange
from app.load import embedded_scene
from app.network.selection import find_models
from app.network.session import Network
from app.renderer import Renderer
from app.settings import Settings

Json = dict[str, Any]

ROOT = Path(__file__).resolve().parents[2]
WARM_UP, REPEATS = 5, 30


@dataclass(frozen=True)
class Options:
    """What to measure.

    Attributes
    ----------
    out : Path
        Folder for pictures and logs.
    quick : bool
        Draw small pictures and few frames.
    scene : Path or None
        A scene file whose frames are timed too.
    """

    out: Path
    quick: bool = False
    scene: Path | None = None

    @property
    def sizes(self) -> tuple[tuple[int, int], ...]:
        """Width and height of the pictures."""
        return ((96, 72),) if self.quick else ((1024, 768), (1920, 1080))


def skipped(reason: str) -> Json:
    """The result of a section that can't run on this machine."""
    return {"skipped": reason}


def measure_ms(run: Callable[[], object], options: Options, repeats: int = REPEATS) -> Json:
    """Median and 10th percentile of the milliseconds that ``run`` takes, after a few uncounted runs."""
    for _ in range(1 if options.quick else WARM_UP):
        run()
    times = []
    for _ in range(2 if options.quick else repeats):
        begin = perf_counter()
        run()
        times.append((perf_counter() - begin) * 1e3)
    return {"median": round(float(np.median(times)), 4), "p10": round(float(np.percentile(times, 10)), 4)}


def max_error(values: F32, reference: F32) -> float:
    """Largest absolute error, relative to the reference's largest absolute value."""
    return float(np.abs(values - reference).max() / np.abs(reference).max())


def mean_error(values: F32, reference: F32) -> float:
    """Mean absolute error, relative to the reference's mean absolute value."""
    return float(np.abs(values - reference).mean() / np.abs(reference).mean())


def format_size(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"


def open_renderer(model: str, size: tuple[int, int]) -> Renderer:
    """A renderer of the embedded scene with ``model`` on the CPU, which has drawn one frame."""
    scene = embedded_scene()
    renderer = Renderer(scene, Settings(size=size, provider="cpu"), find_models(model), CopyExchange)
    renderer.advance(scene.cameras[scene.default_camera].at(0.0), 0.0)
    return renderer


def network_of(renderer: Renderer) -> Network:
    """The network that computes a renderer's indirect light."""
    network = renderer._models.indirect
    assert isinstance(network, Network)
    return network


def read_inputs(model: str, size: tuple[int, int]) -> dict[str, F32]:
    """The tensors that ``model`` reads in the first frame of the embedded scene."""
    with open_renderer(model, size) as renderer:
        return {name: values.copy() for name, values in network_of(renderer)._buffers.items()}


def run_python(*arguments: str, timeout: float | None = None) -> subprocess.CompletedProcess[str]:
    """Run ``python`` with ``arguments`` in the project's root."""
    environment = {**os.environ, "COLUMNS": "160", "PYTHONPATH": str(ROOT)}
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False, cwd=ROOT,
                          env=environment, timeout=timeout)
