"""CPU and GPU time of each pass, taken by the renderer around it, and a copy as their yardstick."""

import time
from collections import defaultdict, deque
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from app.gl.context import Device

MILLI, NANO_PER_MILLI = 1e3, 1e6
MAX_FRAMES = 4096  # that are kept, so that memory stays flat


class Timer:
    """Collects milliseconds per pass and frame.

    CPU time of a pass includes its GPU work on a software renderer only because ``wait`` finishes
    the GPU before the clock is read.
    """

    def __init__(self, device: Device, wait: bool) -> None:
        self._device = device
        self._query = device.ctx.query(time=True) if wait else None  # one for all: moderngl can't give one back
        self._cpu: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=MAX_FRAMES))
        self._gpu: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=MAX_FRAMES))
        self._gpu_sum = 0.0
        self._measured: list[str] = []  # in this frame

    @contextmanager
    def measure(self, name: str) -> Iterator[None]:
        """Time the block under ``name``; such blocks can't be nested, since GL has one timer."""
        start = time.perf_counter()
        if self._query is not None:
            with self._query:
                yield
            self._device.ctx.finish()
            wall = (time.perf_counter() - start) * MILLI
            # The first query of a context is wrong on llvmpipe; no block can take longer than the wall clock says.
            self._gpu[name].append(min(self._query.elapsed / NANO_PER_MILLI, wall))
            self._gpu_sum += self._gpu[name][-1]
        else:
            yield
        self._cpu[name].append((time.perf_counter() - start) * MILLI)
        self._measured.append(name)

    @contextmanager
    def frame(self) -> Iterator[None]:
        """Time a whole frame, whose GPU time is the sum of the blocks inside; a frame that raises is not counted."""
        start, self._gpu_sum = time.perf_counter(), 0.0
        self._measured.clear()
        try:
            yield
        except BaseException:
            for name in self._measured:
                self._cpu[name].pop()
                if self._query is not None:
                    self._gpu[name].pop()
            raise
        self._cpu["frame"].append((time.perf_counter() - start) * MILLI)
        self._gpu["frame"].append(self._gpu_sum)

    def extend(self, name: str, cpu_ms: float) -> None:
        """Add to the newest measurement of ``name``, if there is one."""
        if self._cpu.get(name):
            self._cpu[name][-1] += cpu_ms

    def report(self, newest: int = MAX_FRAMES) -> dict[str, dict[str, dict[str, float]]]:
        """``{name: {"cpu_ms": {"median", "p95"}, "gpu_ms": {…}}}`` over the ``newest`` frames."""
        return {name: {"cpu_ms": _summary([*values][-newest:]), "gpu_ms": _summary([*self._gpu[name]][-newest:])}
                for name, values in self._cpu.items()}

    def clear(self) -> None:
        self._cpu.clear()
        self._gpu.clear()


class Yardstick:
    """The yardstick of pass times: copies an RGBA16F texture of ``size``, width and height."""

    def __init__(self, device: Device, size: tuple[int, int]) -> None:
        self._device = device
        self._source = device.ctx.texture(size, 4, dtype="f2")
        self._target = device.ctx.framebuffer([device.ctx.texture(size, 4, dtype="f2")])
        self._program = device.fullscreen("copy.frag")

    def run(self) -> None:
        self._target.use()
        self._source.use(0)
        self._program.set(source=0)
        self._device.draw_fullscreen(self._program)


def _summary(values: list[float]) -> dict[str, float]:
    if not values:
        return {"median": 0.0, "p95": 0.0}
    return {"median": float(np.median(values)), "p95": float(np.percentile(values, 95))}
