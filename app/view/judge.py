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

F32 = NDArray[np.float32]
Errors = list[dict[str, float]]

SECONDS = 1.0  # from one judgement to the next


class Judge:
    """Judges one frame at a time; of those that come meanwhile the newest is next.

    Parameters
    ----------
    tell : callable
        Takes the errors of each model's picture.
    """

    def __init__(self, tell: Callable[[Errors], object]) -> None:
        self._tell = tell
        self._work: asyncio.Task[None] | None = None
        self._next: tuple[Sequence[F32], F32, bool] | None = None

    def offer(self, pictures: Sequence[F32], truth: Truth, still: bool) -> None:
        """Judge linear ``pictures`` soon; FLIP, which takes long, only if ``still``."""
        self._next = (pictures, truth.layers["final"], still) if pictures else None
        if self._work is None or self._work.done():
            self._work = asyncio.create_task(self._judge())

    def stop(self) -> None:
        """Judge no further."""
        if self._work is not None:
            self._work.cancel()

    async def _judge(self) -> None:
        while self._next is not None:
            (pictures, truth, still), self._next = self._next, None
            if all(picture.shape == truth.shape for picture in pictures):
                self._tell([await asyncio.to_thread(errors_of, picture, truth, still) for picture in pictures])
            await asyncio.sleep(SECONDS)


def errors_of(picture: F32, truth: F32, still: bool) -> dict[str, float]:
    """PSNR and relMSE, and FLIP where it is wanted and installed."""
    found = {"psnr": psnr(picture, truth), "rel_mse": rel_mse(picture, truth)}
    if still:
        with suppress(AfterglowError):
            found["flip"] = flip(picture, truth)
    return {name: value for name, value in found.items() if np.isfinite(value)}
