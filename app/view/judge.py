"""Errors of what is shown against the truth, in a thread beside the painter."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from app.bench.truth import Truth
from app.errors import AfterglowError
from app.metrics import flip, psnr, rel_mse
from app.view.newest import Newest

F32 = NDArray[np.float32]
Errors = list[dict[str, float]]

SECONDS = 1.0  # from one judgement to the next


class Judge:
    """Judges one frame at a time; of those that come meanwhile the newest is next.

    Parameters
    ----------
    tell : callable
        Takes the errors of each model's picture.
    complain : callable
        Takes what went wrong.
    """

    def __init__(self, tell: Callable[[Errors], object], complain: Callable[[Exception], object]) -> None:
        self._tell = tell
        self._work = Newest(self._judge, complain, SECONDS)

    def offer(self, pictures: Sequence[F32], truth: Truth, still: bool) -> None:
        """Judge linear ``pictures`` soon; FLIP, which takes long, only if ``still``."""
        if pictures:
            self._work.offer((pictures, truth.layers["final"], still))

    def stop(self) -> None:
        """Judge no further."""
        self._work.stop()

    async def _judge(self, asked: tuple[Sequence[F32], F32, bool]) -> None:
        pictures, truth, still = asked
        if all(picture.shape == truth.shape for picture in pictures):
            self._tell([await asyncio.to_thread(errors_of, picture, truth, still) for picture in pictures])


def errors_of(picture: F32, truth: F32, still: bool) -> dict[str, float]:
    """PSNR and relMSE, and FLIP where it is wanted and installed."""
    found = {"psnr": psnr(picture, truth), "rel_mse": rel_mse(picture, truth)}
    if still:
        with suppress(AfterglowError):
            found["flip"] = flip(picture, truth)
    return {name: value for name, value in found.items() if np.isfinite(value)}
