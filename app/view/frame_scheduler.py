"""Where the server lays down the newest state and the render_thread takes it up; no GL, no network."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from threading import Condition

from app.view.state import State

STILL_FRAMES = 64  # of an unchanged state, until temporal anti-aliasing shows nothing new
QUIET = 0.05       # seconds after a changed frame until the first such one, for whose end the next input would wait
BREATH = 0.001     # seconds between passes of such a frame, since OpenGL calls let no other thread hear of an input


@dataclass(frozen=True)
class Task:
    """One frame to draw: of which state, which version of it, the how-manieth of that, and up to which input."""

    state: State
    version: int
    repeat: int
    input: int


class FrameScheduler:
    """Holds one state; whatever was laid down before is forgotten."""

    def __init__(self, state: State) -> None:
        self._changed = Condition()
        self._state = self._drawable = state
        self._version = self._input = self._watchers = 0
        self._drawn, self._repeat = -1, 0
        self._closed = False

    @property
    def state(self) -> State:
        """The newest one."""
        with self._changed:
            return self._state

    @property
    def version(self) -> int:
        """Another number after each change."""
        with self._changed:
            return self._version

    def change(self, change: Callable[[State], State], number: int = 0) -> None:
        """Replace the state; ``number`` is that of the input which did it. Where ``change`` raises, nothing changes."""
        with self._changed:
            state = change(self._state)
            self._input = number or self._input
            if state != self._state or number:
                self._state, self._version = state, self._version + 1
                self._changed.notify_all()

    def watch(self, watchers: int) -> None:
        """How many pages look on; without any, nothing is drawn."""
        with self._changed:
            if watchers > self._watchers:
                self._version += 1  # so that the new one sees a frame
            self._watchers = watchers
            self._changed.notify_all()

    def take(self) -> Task | None:
        """Wait for something to draw; None when the scheduler has closed."""
        with self._changed:
            self._changed.wait_for(self._has_work)
            if self._version == self._drawn and self._repeat == 0:
                self._changed.wait_for(self._is_new, QUIET)
            if self._closed:
                return None
            self._repeat = self._repeat + 1 if self._version == self._drawn else 0
            self._drawn = self._version
            return Task(self._state, self._version, self._repeat, self._input)

    def wants(self, task: Task) -> bool:
        """Whether to go on with ``task``: what answers an input is always finished, other frames till the next one."""
        with self._changed:
            return task.repeat == 0 or not self._changed.wait_for(self._is_new, BREATH)

    def accept(self, task: Task) -> None:
        """The state of ``task`` could be drawn."""
        with self._changed:
            self._drawable = task.state

    def refuse(self, task: Task) -> None:
        """It could not: if it is still the newest, go back to one that could, or wait for another."""
        with self._changed:
            if task.version == self._version:
                if self._state == self._drawable:
                    self._repeat = STILL_FRAMES
                else:
                    self._state, self._version = self._drawable, self._version + 1

    def close(self) -> None:
        """End the wait of ``take``."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _is_new(self) -> bool:
        return self._closed or self._version != self._drawn

    def _has_work(self) -> bool:
        frames = STILL_FRAMES if self._state.taa else 1
        return self._closed or (self._watchers > 0 and (self._is_new() or self._repeat + 1 < frames))
