"""Times: configurations take turns, so that whatever else the machine does hits all of them alike."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from time import perf_counter
from types import TracebackType

import numpy as np

from app.evaluation.configurations import Configuration
from app.math3d import look_rotation
from app.renderer import Renderer
from app.scene import Camera, Scene
from app.settings import Settings

BURST = 6              # frames of one turn
WARM_UP = 2            # frames at the beginning of a turn that don't count: caches still hold the others' data
SWAY = 2e-3            # of the scene's longest edge: how far the camera moves between frames
FRAME_SECONDS = 1 / 30
YARD = 1024            # rows and columns of the yardstick's matrix
FRAME, YARDSTICK = "frame", "copy"


@dataclass(frozen=True)
class Spread:
    """Milliseconds over all counted frames, and the median of each turn."""

    median: float
    p95: float
    turns: tuple[float, ...]

    @staticmethod
    def of(turns: Sequence[Sequence[float]]) -> Spread:
        """Summary of the frames of several turns."""
        together = np.concatenate([np.asarray(turn, np.float64) for turn in turns])
        return Spread(float(np.median(together)), float(np.percentile(together, 95)),
                      tuple(float(np.median(turn)) for turn in turns))


@dataclass
class TimedRun:
    """A configuration that draws a scene, with the frame times of each turn by stage."""

    scene: Scene
    camera: Camera
    configuration: Configuration
    turns: list[dict[str, list[float]]] = field(default_factory=list)
    device: dict[str, str] = field(default_factory=dict)

    @property
    def stages(self) -> dict[str, Spread]:
        """By pass in the order of the frame; ``frame`` is all of it and ``copy`` the yardstick."""
        names = dict.fromkeys(name for turn in self.turns for name in turn)
        return {name: Spread.of([turn[name] for turn in self.turns if name in turn]) for name in names}


class InterleavedTimer:
    """Keeps a renderer for each timed_run, and lets them take turns; a context manager."""

    def __init__(self, timed_runs: Sequence[TimedRun], provider: str) -> None:
        self._contenders, self._provider = timed_runs, provider
        self._stack = ExitStack()
        self._lanes: list[tuple[TimedRun, Renderer, Iterator[int]]] = []

    def __enter__(self) -> InterleavedTimer:
        with self._stack as stack:
            for c in self._contenders:
                settings = Settings(size=c.configuration.size, timing=True, provider=self._provider)
                renderer = stack.enter_context(Renderer(c.scene, settings, c.configuration.models))
                c.device = dict(renderer.device)
                self._lanes.append((c, renderer, iter(range(2**31))))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._stack.close()

    def turn(self) -> None:
        """Each timed_run draws a burst of frames while its camera sways."""
        for timed_run, renderer, index in self._lanes:
            times: dict[str, list[float]] = defaultdict(list)
            for n in range(WARM_UP + BURST):
                frame = next(index)
                renderer.reset_timing()
                renderer.render(swayed(timed_run.camera, timed_run.scene, frame), frame * FRAME_SECONDS)
                if n >= WARM_UP:
                    report = renderer.timing()
                    for name, stats in {**report["passes"], FRAME: report["frame"]}.items():
                        times[name].append(stats["cpu_ms"]["median"])
            timed_run.turns.append(dict(times))


def yardstick() -> list[float]:
    """Milliseconds of a matrix product on all cores, a few times: nothing that the program does moves it."""
    matrix = np.ones((YARD, YARD), np.float32)
    times = []
    for _ in range(WARM_UP + BURST):
        begin = perf_counter()
        matrix @ matrix
        times.append((perf_counter() - begin) * 1e3)
    return times[WARM_UP:]


def swayed(camera: Camera, scene: Scene, frame: int) -> Camera:
    """The camera a little to its right or left, so that no frame is like the one before."""
    right = look_rotation(np.subtract(camera.target, camera.eye), np.asarray(camera.up))[0]
    shift = right * SWAY * scene.longest_edge * np.sin(frame)
    eye, target = (tuple((np.asarray(p) + shift).tolist()) for p in (camera.eye, camera.target))
    return replace(camera, eye=eye, target=target)
