"""Baselines: the path tracer at a few samples per pixel, with and without Open Image Denoise."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import perf_counter

from app.arrays import F32
from app.errors import SceneError
from app.evaluation.denoise import run_denoiser
from app.evaluation.reference import BaselineImage, Reference, read_baseline_images

Trace = Callable[[], list[BaselineImage]]

COUNTS = (1, 2, 4, 8, 16, 32, 64, 128, 256)  # samples per pixel
QUALITIES = ("fast", "high")                 # of the denoiser
REPEATS = 5                                  # denoising runs whose median time counts
TRACED, DENOISED = "path tracer", "denoised"
NAMES = (TRACED, *(f"{DENOISED} ({quality})" for quality in QUALITIES))


@dataclass(frozen=True, eq=False)
class Baseline:
    """A linear ``picture``, shape (H, W, 3), of ``spp`` samples per pixel, and the milliseconds it took."""

    name: str
    spp: int
    ms: float
    picture: F32


def draw_baselines(trace: Trace) -> list[Baseline]:
    """The path tracer's pictures, raw and denoised, by name and rising sample count.

    The path tracer times itself. Denoising takes the median of a few runs after one that warms up.
    """
    traced = trace()
    baselines = [Baseline(TRACED, image.spp, image.seconds * 1e3, image.final) for image in traced]
    for quality in QUALITIES:
        for image in traced[:1]:
            denoise(image, quality)
        for image in traced:
            seconds = []
            for _ in range(REPEATS):
                begin = perf_counter()
                picture = denoise(image, quality)
                seconds.append(perf_counter() - begin)
            ms = (image.seconds + median(seconds)) * 1e3
            baselines.append(Baseline(f"{DENOISED} ({quality})", image.spp, ms, picture))
    return baselines


def recorded_trace(folder: Path, reference: Reference) -> Trace:
    """A function that returns the pictures and times stored in ``folder``, if any.

    Raises
    ------
    SceneError
        When a file is damaged or its size is not the reference's.
    """
    recorded = read_baseline_images(folder)
    for image in recorded:
        if image.final.shape != reference.layers["final"].shape:
            raise SceneError(f"the picture of {image.spp} samples is not of the reference's size", folder,
                             f"expected {reference.size[0]}x{reference.size[1]}")
    return lambda: recorded


def denoise(image: BaselineImage, quality: str) -> F32:
    """Open Image Denoise with albedo and normal as guides.

    Raises
    ------
    MissingExtraError
        When Open Image Denoise is not installed.
    """
    color, normal, albedo = (x[..., :3] for x in (image.final, image.normal, image.albedo))
    return run_denoiser(color, normal, albedo, quality)
