"""Asynchronous work of which only the latest item matters."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class LatestOnly(Generic[T]):
    """Processes one item at a time; an item that is superseded while it waits is dropped.

    Parameters
    ----------
    work : callable
        Coroutine function that processes an item; it runs long computations in a thread.
    on_error : callable
        Receives an exception of ``work``; later items are still processed.
    pause_seconds : float
        Seconds from the end of one item to the start of the next.
    """

    def __init__(self, work: Callable[[T], Awaitable[None]], on_error: Callable[[Exception], object],
                 pause_seconds: float = 0.0) -> None:
        self._work, self._on_error, self._pause_seconds = work, on_error, pause_seconds
        self._next: list[T] = []
        self._task: asyncio.Task[None] | None = None

    def offer(self, item: T) -> None:
        """Process ``item`` next, in place of the item that was waiting."""
        self._next[:] = [item]
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._run())

    def stop(self) -> None:
        """Drop the waiting item and cancel the current one."""
        self._next.clear()
        if self._task is not None:
            self._task.cancel()

    async def _run(self) -> None:
        while self._next:
            try:
                await self._work(self._next.pop())
            except Exception as error:  # any error, MemoryError included: pages must not wait for ever
                self._on_error(error)
            await asyncio.sleep(self._pause_seconds)
