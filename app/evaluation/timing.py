"""Frame times, measured in interleaved rounds so that other load on the machine affects all configurations alike."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import count
from time import perf_counter

import numpy as np

from app.evaluation.configurations import Configuration
from app.math3d import look_rotation
from app.renderer import Renderer
from app.scene import Camera, Scene

BURST = 6              # counted frames per round
WARM_UP = 2            # uncounted frames before them: caches still hold the data of the other configurations
SWAY = 2e-3            # camera displacement between frames, relative to the scene's longest edge
FRAME_SECONDS = 1 / 30
MATRIX_SIZE = 1024     # rows and columns of the yardstick's matrices
FRAME, YARDSTICK = "frame", "copy"


@dataclass(frozen=True)
class Spread:
    """Median and 95th percentile in milliseconds over all counted frames, and the median of each round."""

    median: float
    p95: float
    rounds: tuple[float, ...]

    @staticmethod
    def of(rounds: Sequence[Sequence[float]]) -> Spread:
        """Summarise the frame times of several rounds."""
        together = np.concatenate([np.asarray(times, np.float64) for times in rounds])
        return Spread(float(np.median(together)), float(np.percentile(together, 95)),
                      tuple(float(np.median(times)) for times in rounds))


@dataclass
class TimedRun:
    """A configuration that draws a scene, with its frame times in milliseconds by stage for each round."""

    scene: Scene
    camera: Camera
    configuration: Configuration
    rounds: list[dict[str, list[float]]] = field(default_factory=list)
    device: dict[str, str] = field(default_factory=dict)

    @property
    def stages(self) -> dict[str, Spread]:
        """Times by pass in frame order; ``frame`` is the whole frame and ``copy`` the yardstick."""
        names = dict.fromkeys(name for times in self.rounds for name in times)
        return {name: Spread.of([times[name] for times in self.rounds if name in times]) for name in names}


class InterleavedTimer:
    """Keeps one renderer per run and draws with them in alternation; a context manager."""

    def __init__(self, runs: Sequence[TimedRun], provider: str) -> None:
        self._renderers: list[tuple[TimedRun, Renderer, Iterator[int]]] = []
        with ExitStack() as stack:
            for run in runs:
                settings = run.configuration.settings(provider, timing=True)
                renderer = stack.enter_context(Renderer(run.scene, settings, run.configuration.models))
                run.device = dict(renderer.device)
                self._renderers.append((run, renderer, count()))
            self._stack = stack.pop_all()

    def __enter__(self) -> InterleavedTimer:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def run_round(self) -> None:
        """Draw a burst of frames with each renderer while its camera sways."""
        for run, renderer, index in self._renderers:
            times: dict[str, list[float]] = defaultdict(list)
            for n in range(WARM_UP + BURST):
                frame = next(index)
                renderer.reset_timing()
                renderer.render(swayed(run.camera, run.scene, frame), frame * FRAME_SECONDS)
                if n >= WARM_UP:
                    report = renderer.timing()
                    for name, stats in {**report["passes"], FRAME: report["frame"]}.items():
                        times[name].append(stats["cpu_ms"]["median"])
            run.rounds.append(dict(times))


def yardstick() -> list[float]:
    """Milliseconds of matrix products on all cores, which no change of the program affects."""
    matrix = np.ones((MATRIX_SIZE, MATRIX_SIZE), np.float32)
    times = []
    for _ in range(WARM_UP + BURST):
        begin = perf_counter()
        matrix @ matrix
        times.append((perf_counter() - begin) * 1e3)
    return times[WARM_UP:]


def swayed(camera: Camera, scene: Scene, frame: int) -> Camera:
    """``camera`` shifted slightly to its right or left, so that no two consecutive frames are equal."""
    right = look_rotation(np.subtract(camera.target, camera.eye), np.asarray(camera.up))[0]
    shift = right * SWAY * scene.longest_edge * np.sin(frame)
    eye, target = (tuple((np.asarray(p) + shift).tolist()) for p in (camera.eye, camera.target))
    return replace(camera, eye=eye, target=target)
