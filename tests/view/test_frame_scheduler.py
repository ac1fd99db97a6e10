"""The scheduler: the newest state wins, and nothing is drawn that nobody sees."""

from __future__ import annotations

import threading
from dataclasses import replace

from app.scene import Camera
from app.view.frame_scheduler import STILL_FRAMES, FrameScheduler, Task
from app.view.state import State

STATE = State((64, 48), Camera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)), (), "none")


def scheduler() -> FrameScheduler:
    made = FrameScheduler(STATE)
    made.watch(1)
    return made


def exposed(exposure: float, number: int, at: FrameScheduler) -> None:
    at.change(lambda state: replace(state, exposure=exposure), number)


def take_within(at: FrameScheduler, seconds: float) -> list[Task | None]:
    found: list[Task | None] = []
    thread = threading.Thread(target=lambda: found.append(at.take()), daemon=True)
    thread.start()
    thread.join(seconds)
    return found


def test_the_newest_state_wins() -> None:
    at = scheduler()
    for number in range(1, 1000):
        exposed(number, number, at)
    task = at.take()
    assert task is not None
    assert (task.state.exposure, task.input, task.repeat) == (999, 999, 0)


def test_a_still_picture_is_drawn_until_it_has_settled() -> None:
    at = scheduler()
    repeats = [task.repeat for _ in range(STILL_FRAMES) if (task := at.take())]
    assert repeats == list(range(STILL_FRAMES))
    assert take_within(at, 0.2) == []
    exposed(2, 1, at)
    task = at.take()
    assert task is not None and task.repeat == 0


def test_an_input_ends_what_only_refines_and_never_what_answers_another() -> None:
    at = scheduler()
    exposed(2, 1, at)
    answer = at.take()
    assert answer is not None
    exposed(3, 2, at)
    assert at.wants(answer)
    again, refining = at.take(), at.take()
    assert again is not None and refining is not None
    assert at.wants(refining)
    exposed(4, 3, at)
    assert at.wants(again) and not at.wants(refining)
    task = at.take()
    assert task is not None and (task.input, task.repeat) == (3, 0)


def test_without_anti_aliasing_one_frame_is_enough() -> None:
    at = scheduler()
    at.change(lambda state: replace(state, taa=False))
    assert at.take() is not None
    assert take_within(at, 0.2) == []


def test_nobody_watches_nothing_is_drawn() -> None:
    at = FrameScheduler(STATE)
    waiting = take_within(at, 0.2)
    assert waiting == []
    at.watch(1)
    for _ in range(100):
        if waiting:
            break
        threading.Event().wait(0.02)
    assert waiting and waiting[0] is not None


def test_a_state_that_can_t_be_drawn_gives_way_to_the_last_that_could() -> None:
    at = scheduler()
    first = at.take()
    assert first is not None
    at.accept(first)
    exposed(3, 1, at)
    bad = at.take()
    assert bad is not None
    at.refuse(bad)
    assert at.state == STATE
    again = at.take()
    assert again is not None and again.state == STATE


def test_a_first_state_that_can_t_be_drawn_is_not_tried_for_ever() -> None:
    at = scheduler()
    task = at.take()
    assert task is not None
    at.refuse(task)
    assert take_within(at, 0.2) == []


def test_closing_ends_the_wait() -> None:
    at = FrameScheduler(STATE)
    at.close()
    assert at.take() is None
