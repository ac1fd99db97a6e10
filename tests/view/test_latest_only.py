"""LatestOnly: superseded items are dropped, and errors are reported."""

from __future__ import annotations

import asyncio

import pytest

from app.view.latest_only import LatestOnly


def test_superseded_items_are_dropped_and_the_loop_stays_free() -> None:
    done: list[int] = []

    async def work(item: int) -> None:
        await asyncio.sleep(0.02)
        done.append(item)

    async def run() -> None:
        latest = LatestOnly(work, pytest.fail)
        for item in range(100):
            latest.offer(item)
            await asyncio.sleep(0.001)
        await asyncio.sleep(0.1)
        assert len(done) < 20 and done[-1] == 99
        latest.offer(100)
        latest.stop()
        await asyncio.sleep(0.05)
        assert done[-1] == 99

    asyncio.run(run())


def test_an_error_is_reported_and_the_next_item_is_processed() -> None:
    done: list[int] = []
    errors: list[Exception] = []

    async def work(item: int) -> None:
        if item == 1:
            raise MemoryError("out of memory")
        done.append(item)

    async def run() -> None:
        latest = LatestOnly(work, errors.append)
        for item in range(3):
            latest.offer(item)
            await asyncio.sleep(0.01)

    asyncio.run(run())
    assert done == [0, 2] and [str(error) for error in errors] == ["out of memory"]
