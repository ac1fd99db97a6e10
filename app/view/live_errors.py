"""Errors of what is shown against the reference, in a thread beside the render_thread."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from app.errors import AfterglowError
from app.evaluation.metrics import flip, psnr, rel_mse
from app.evaluation.reference import Reference
from app.view.latest_only import LatestOnly

F32 = NDArray[np.float32]
Errors = list[dict[str, float]]

SECONDS = 1.0  # from one judgement to the next


class LiveErrors:
    """Judges one frame at a time; of those that come meanwhile the newest is next.

    Parameters
    ----------
    tell : callable
        Takes the errors of each model's picture.
    on_error : callable
        Takes what went wrong.
    """

    def __init__(self, tell: Callable[[Errors], object], on_error: Callable[[Exception], object]) -> None:
        self._tell = tell
        self._work = LatestOnly(self._judge, on_error, SECONDS)

    def offer(self, pictures: Sequence[F32], reference: Reference, still: bool) -> None:
        """LiveErrors linear ``pictures`` soon; FLIP, which takes long, only if ``still``."""
        if pictures:
            self._work.offer((pictures, reference.layers["final"], still))

    def stop(self) -> None:
        """LiveErrors no further."""
        self._work.stop()

    async def _judge(self, asked: tuple[Sequence[F32], F32, bool]) -> None:
        pictures, reference, still = asked
        if all(picture.shape == reference.shape for picture in pictures):
            self._tell([await asyncio.to_thread(errors_of, picture, reference, still) for picture in pictures])


def errors_of(picture: F32, reference: F32, still: bool) -> dict[str, float]:
    """PSNR and relMSE, and FLIP where it is wanted and installed."""
    found = {"psnr": psnr(picture, reference), "rel_mse": rel_mse(picture, reference)}
    if still:
        with suppress(AfterglowError):
            found["flip"] = flip(picture, reference)
    return {name: value for name, value in found.items() if np.isfinite(value)}
