"""CPU and GPU time of each pass, taken by the renderer around it."""

from __future__ import annotations

import time
from collections import defaultdict, deque
from collections.abc import Collection, Iterator
from contextlib import contextmanager

import numpy as np

from app.gl.context import Device

MILLI, NANO_PER_MILLI = 1e3, 1e6
NEWEST = 4096  # frames that are kept, so that memory stays flat


class Timer:
    """Collects milliseconds per pass and frame.

    CPU time of a pass includes its GPU work on a software renderer only because ``wait`` finishes
    the GPU before the clock is read.
    """

    def __init__(self, device: Device, wait: bool) -> None:
        self._device = device
        self._query = device.ctx.query(time=True) if wait else None  # one for all: moderngl can't give one back
        self._cpu: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=NEWEST))
        self._gpu: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=NEWEST))
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
            # A context's first query counts from nowhere on llvmpipe, and no block can take longer than the clock says.
            self._gpu[name].append(min(self._query.elapsed / NANO_PER_MILLI, wall))
            self._gpu_sum += self._gpu[name][-1]
        else:
            yield
        self._cpu[name].append((time.perf_counter() - start) * MILLI)
        self._measured.append(name)

    @contextmanager
    def frame(self) -> Iterator[None]:
        """Time a whole frame; its GPU time is the sum of the blocks measured inside. One that raises never was."""
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

    def report(self, newest: int = NEWEST) -> dict[str, dict[str, dict[str, float]]]:
        """``{name: {"cpu_ms": {"median", "p95"}, "gpu_ms": {…}}}`` over the ``newest`` frames."""
        return {name: {"cpu_ms": _summary([*values][-newest:]), "gpu_ms": _summary([*self._gpu[name]][-newest:])}
                for name, values in self._cpu.items()}

    def clear(self) -> None:
        self._cpu.clear()
        self._gpu.clear()


def _summary(values: Collection[float]) -> dict[str, float]:
    if not values:
        return {"median": 0.0, "p95": 0.0}
    return {"median": float(np.median(list(values))), "p95": float(np.percentile(list(values), 95))}
