"""CPU and GPU time of each pass, taken by the renderer around it."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from app.gl.context import Device

MILLI = 1e3


class Timer:
    """Collects milliseconds per pass and frame.

    CPU time of a pass includes its GPU work on a software renderer only because ``wait`` finishes
    the GPU before the clock is read.
    """

    def __init__(self, device: Device, wait: bool) -> None:
        self._device, self._wait = device, wait
        self._cpu: dict[str, list[float]] = defaultdict(list)
        self._gpu: dict[str, list[float]] = defaultdict(list)

    @contextmanager
    def measure(self, name: str, gpu: bool = True) -> Iterator[None]:
        """Time the block under ``name``; blocks with ``gpu`` can't be nested (GL has one timer)."""
        query = self._device.ctx.query(time=True) if self._wait and gpu else None
        start = time.perf_counter()
        if query is None:
            yield
        else:
            with query:
                yield
            self._device.ctx.finish()
            self._gpu[name].append(query.elapsed / 1e6)
        self._cpu[name].append((time.perf_counter() - start) * MILLI)

    def extend(self, name: str, cpu_ms: float) -> None:
        """Add to the newest measurement of ``name``, if there is one."""
        if self._cpu.get(name):
            self._cpu[name][-1] += cpu_ms

    def report(self) -> dict[str, dict[str, dict[str, float]]]:
        """``{name: {"cpu_ms": {"median", "p95"}, "gpu_ms": {…}}}`` over all frames so far."""
        return {name: {"cpu_ms": _summary(values), "gpu_ms": _summary(self._gpu[name])}
                for name, values in self._cpu.items()}

    def clear(self) -> None:
        self._cpu.clear()
        self._gpu.clear()


def _summary(values: list[float]) -> dict[str, float]:
    if not values:
        return {"median": 0.0, "p95": 0.0}
    return {"median": float(np.median(values)), "p95": float(np.percentile(values, 95))}
