"""Work of which only the newest matters, one piece after the other."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class LatestOnly(Generic[T]):
    """Does ``work`` for what it is offered; what is overtaken while it works is never done.

    Parameters
    ----------
    work : callable
        A coroutine function; what takes long in it runs in a thread.
    on_error : callable
        Takes what went wrong in it; the next piece is done all the same.
    rest : float
        Seconds from the end of one piece to the next.
    """

    def __init__(self, work: Callable[[T], Awaitable[None]], on_error: Callable[[Exception], object],
                 rest: float = 0.0) -> None:
        self._work, self._on_error, self._rest = work, on_error, rest
        self._next: list[T] = []
        self._task: asyncio.Task[None] | None = None

    def offer(self, item: T) -> None:
        """Do this next, in place of what was to be done next."""
        self._next[:] = [item]
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._run())

    def stop(self) -> None:
        """Do no more."""
        self._next.clear()
        if self._task is not None:
            self._task.cancel()

    async def _run(self) -> None:
        while self._next:
            try:
                await self._work(self._next.pop())
            except Exception as error:  # of the memory, too: the pages are told instead of waiting for ever
                self._on_error(error)
            await asyncio.sleep(self._rest)
