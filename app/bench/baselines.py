"""What a user would pick instead: the path tracer at a few samples per pixel, with and without Open Image Denoise."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from app.errors import SceneError
from app.evaluation.reference import Order, Plain, Reference, make_plain, read_plain
from app.extras import extra_module

F32 = NDArray[np.float32]
Trace = Callable[[], list[Plain]]

COUNTS = (1, 2, 4, 8, 16, 32, 64, 128, 256)  # samples per pixel
QUALITIES = ("fast", "high")                 # of the denoiser
DENOISINGS = 5
TRACED, DENOISED = "path tracer", "denoised"
NAMES = (TRACED, *(f"{DENOISED} ({quality})" for quality in QUALITIES))


@dataclass(frozen=True, eq=False)
class Baseline:
    """A linear ``picture`` [H, W, 3] of ``spp`` samples per pixel, and the milliseconds that it took."""

    name: str
    spp: int
    ms: float
    picture: F32


def draw_baselines(trace: Trace) -> list[Baseline]:
    """The path tracer's pictures, bare and denoised, by name and rising sample count.

    Tracing is timed by who traces, denoising is the median of a few times after one that loads and builds.
    """
    traced = trace()
    found = [Baseline(TRACED, plain.spp, plain.seconds * 1e3, plain.final) for plain in traced]
    for quality in QUALITIES:
        for plain in traced[:1]:
            denoise(plain, quality)
        for plain in traced:
            seconds = []
            for _ in range(DENOISINGS):
                begin = perf_counter()
                picture = denoise(plain, quality)
                seconds.append(perf_counter() - begin)
            found.append(Baseline(f"{DENOISED} ({quality})", plain.spp, (plain.seconds + median(seconds)) * 1e3, picture))
    return found


def traced_now(order: Order, counts: Sequence[int] = COUNTS) -> Trace:
    """Draws the pictures when it is called."""
    def trace() -> list[Plain]:
        with tempfile.TemporaryDirectory() as folder:
            return make_plain(order, counts, Path(folder))

    return trace


def traced_before(folder: Path, reference: Reference) -> Trace:
    """Takes pictures and times from ``folder``; there may be none.

    Raises
    ------
    SceneError
        When a file is damaged or not of the reference's size.
    """
    found = read_plain(folder)
    for plain in found:
        if plain.final.shape != reference.layers["final"].shape:
            raise SceneError(f"a picture of {plain.spp} samples is not of the reference's size", folder,
                             f"expected {reference.size[0]}x{reference.size[1]}")
    return lambda: found


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
