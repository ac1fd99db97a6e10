"""What a user would pick instead: the path tracer at a few samples per pixel, with and without Open Image Denoise."""

from __future__ import annotations

import tempfile
from collections import defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from app.bench.measure import Spread
from app.bench.truth import Order, Plain, make_plain, read_plain
from app.extras import extra_module

F32 = NDArray[np.float32]
Trace = Callable[[], list[Plain]]

COUNTS = (1, 2, 4, 8, 16, 32, 64, 128, 256)  # samples per pixel
QUALITIES = ("fast", "high")                 # of the denoiser
TRACED, DENOISED = "path tracer", "denoised"
NAMES = (TRACED, *(f"{DENOISED} ({quality})" for quality in QUALITIES))


class Rivals:
    """The path tracer's pictures, as they are and denoised, with their times turn by turn.

    Attributes
    ----------
    pictures : dict
        Linear [H, W, 3] by (name, samples per pixel), the same in every turn.
    """

    def __init__(self, trace: Trace) -> None:
        self._trace = trace
        self._times: dict[tuple[str, int], list[float]] = defaultdict(list)
        self.pictures: dict[tuple[str, int], F32] = {}

    def turn(self) -> None:
        """Draw and denoise everything once."""
        traced = self._trace()
        if traced and not self.pictures:  # the denoiser's first calls load and build
            for quality in QUALITIES:
                denoise(traced[0], quality)
        for plain in traced:
            self._note(TRACED, plain, plain.final, 0.0)
            for name, quality in zip(NAMES[1:], QUALITIES, strict=True):
                begin = perf_counter()
                picture = denoise(plain, quality)
                self._note(name, plain, picture, perf_counter() - begin)

    def times(self) -> dict[tuple[str, int], Spread]:
        """Milliseconds of tracing, and of denoising where it is."""
        return {key: Spread.of([[ms] for ms in turns]) for key, turns in self._times.items()}

    def _note(self, name: str, plain: Plain, picture: F32, more_seconds: float) -> None:
        self._times[name, plain.spp].append((plain.seconds + more_seconds) * 1e3)
        self.pictures.setdefault((name, plain.spp), picture)


def traced_now(order: Order, counts: Sequence[int] = COUNTS) -> Trace:
    """Draws the pictures anew on each call."""
    def trace() -> list[Plain]:
        with tempfile.TemporaryDirectory() as folder:
            return make_plain(order, counts, Path(folder))

    return trace


def traced_before(folder: Path) -> Trace:
    """Takes pictures and times from ``folder``; there may be none."""
    plain = read_plain(folder)
    return lambda: plain


def denoise(plain: Plain, quality: str) -> F32:
    """Open Image Denoise with albedo and normal as guides; linear HDR.

    Raises
    ------
    MissingExtraError
        Without the package pyoidn.
    """
    run = extra_module("pyoidn", "judge").denoise
    color, albedo, normal = (np.ascontiguousarray(x[..., :3], np.float32)
                             for x in (plain.final, plain.albedo, plain.normal))
    return run(color, np.clip(albedo, 0, 1), normal, hdr=True, quality=quality)
