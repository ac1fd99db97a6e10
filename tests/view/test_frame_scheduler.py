"""The frame scheduler: the latest state wins, and frames that nobody sees are not drawn."""

from __future__ import annotations

import threading
from dataclasses import replace

from app.scene import Camera
from app.view.frame_scheduler import FRAMES_PER_STATE, FrameScheduler, FrameTask
from app.view.state import State

STATE = State((64, 48), Camera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)), (), "none")


def make_scheduler() -> FrameScheduler:
    scheduler = FrameScheduler(STATE)
    scheduler.set_pages(1)
    return scheduler


def set_exposure(scheduler: FrameScheduler, exposure: float, input_number: int) -> None:
    scheduler.update(lambda state: replace(state, exposure=exposure), input_number)


def take_within(scheduler: FrameScheduler, seconds: float) -> list[FrameTask | None]:
    """Return a list that holds the next task as soon as there is one; waits up to ``seconds`` for it."""
    tasks: list[FrameTask | None] = []
    thread = threading.Thread(target=lambda: tasks.append(scheduler.take()), daemon=True)
    thread.start()
    thread.join(seconds)
    return tasks


def test_the_latest_state_wins() -> None:
    scheduler = make_scheduler()
    for number in range(1, 1000):
        set_exposure(scheduler, number, number)
    task = scheduler.take()
    assert task is not None
    assert (task.state.exposure, task.input, task.repeat) == (999, 999, 0)


def test_an_unchanged_state_is_drawn_until_it_has_settled() -> None:
    scheduler = make_scheduler()
    repeats = [task.repeat for _ in range(FRAMES_PER_STATE) if (task := scheduler.take())]
    assert repeats == list(range(FRAMES_PER_STATE))
    assert take_within(scheduler, 0.2) == []
    set_exposure(scheduler, 2, 1)
    task = scheduler.take()
    assert task is not None and task.repeat == 0


def test_an_input_interrupts_refining_frames_but_no_answer_to_another_input() -> None:
    scheduler = make_scheduler()
    set_exposure(scheduler, 2, 1)
    answer = scheduler.take()
    assert answer is not None
    set_exposure(scheduler, 3, 2)
    assert scheduler.should_continue(answer)
    next_answer, refinement = scheduler.take(), scheduler.take()
    assert next_answer is not None and refinement is not None
    assert scheduler.should_continue(refinement)
    set_exposure(scheduler, 4, 3)
    assert scheduler.should_continue(next_answer) and not scheduler.should_continue(refinement)
    task = scheduler.take()
    assert task is not None and (task.input, task.repeat) == (3, 0)


def test_without_anti_aliasing_one_frame_is_enough() -> None:
    scheduler = make_scheduler()
    scheduler.update(lambda state: replace(state, taa=False))
    assert scheduler.take() is not None
    assert take_within(scheduler, 0.2) == []


def test_nothing_is_drawn_without_pages() -> None:
    scheduler = FrameScheduler(STATE)
    tasks = take_within(scheduler, 0.2)
    assert tasks == []
    scheduler.set_pages(1)
    for _ in range(100):
        if tasks:
            break
        threading.Event().wait(0.02)
    assert tasks and tasks[0] is not None


def test_a_state_that_cannot_be_drawn_is_replaced_by_the_last_that_could() -> None:
    scheduler = make_scheduler()
    first = scheduler.take()
    assert first is not None
    scheduler.confirm(first)
    set_exposure(scheduler, 3, 1)
    bad = scheduler.take()
    assert bad is not None
    scheduler.reject(bad)
    assert scheduler.state == STATE
    again = scheduler.take()
    assert again is not None and again.state == STATE


def test_a_first_state_that_cannot_be_drawn_is_not_retried_for_ever() -> None:
    scheduler = make_scheduler()
    task = scheduler.take()
    assert task is not None
    scheduler.reject(task)
    assert take_within(scheduler, 0.2) == []


def test_closing_ends_the_wait() -> None:
    scheduler = FrameScheduler(STATE)
    scheduler.close()
    assert scheduler.take() is None
