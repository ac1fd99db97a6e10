"""Errors of the displayed images against the reference, measured in a thread beside the render thread."""

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress

import numpy as np

from app.arrays import F32
from app.errors import AfterglowError
from app.evaluation.metrics import flip, psnr, rel_mse
from app.evaluation.reference import Reference
from app.view.latest_only import LatestOnly

PAUSE_SECONDS = 1.0  # between two measurements


class LiveErrors:
    """Measures one frame at a time; of the frames that arrive meanwhile, only the latest is measured next.

    Parameters
    ----------
    on_errors : callable
        Receives a list with the errors of each model's image.
    on_error : callable
        Receives an exception.
    """

    def __init__(self, on_errors: Callable[[list[dict[str, float]]], object],
                 on_error: Callable[[Exception], object]) -> None:
        self._on_errors = on_errors
        self._work = LatestOnly(self._measure, on_error, PAUSE_SECONDS)

    def offer(self, images: Sequence[F32], reference: Reference, settled: bool) -> None:
        """Measure linear ``images`` soon; FLIP, which is slow, only if the image has ``settled``."""
        if images:
            self._work.offer((images, reference.layers["final"], settled))

    def stop(self) -> None:
        """Cancel all measurements."""
        self._work.stop()

    async def _measure(self, item: tuple[Sequence[F32], F32, bool]) -> None:
        images, reference, settled = item
        if all(image.shape == reference.shape for image in images):
            self._on_errors([await asyncio.to_thread(measure_errors, image, reference, settled) for image in images])


def measure_errors(image: F32, reference: F32, settled: bool) -> dict[str, float]:
    """Return the finite ones of PSNR in dB, relMSE and, if ``settled`` and installed, FLIP."""
    errors = {"psnr": psnr(image, reference), "rel_mse": rel_mse(image, reference)}
    if settled:
        with suppress(AfterglowError):
            errors["flip"] = flip(image, reference)
    return {name: value for name, value in errors.items() if np.isfinite(value)}
