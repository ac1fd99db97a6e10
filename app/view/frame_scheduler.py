"""Hands the latest state from the server to the render thread, without GL or network."""

from collections.abc import Callable
from dataclasses import dataclass
from threading import Condition

from app.view.state import State

FRAMES_PER_STATE = 64         # after which temporal anti-aliasing shows no further change
REFINE_DELAY_SECONDS = 0.05   # wait before the first refining frame, so that the next input of a drag comes first
YIELD_SECONDS = 0.001         # pause between passes of a refining frame: OpenGL calls hold Python's global lock


@dataclass(frozen=True)
class FrameTask:
    """One frame to draw.

    Attributes
    ----------
    version : int
        Version of ``state``.
    repeat : int
        Number of frames already drawn of this version; a frame with ``repeat`` > 0 only refines the image.
    input : int
        Number of the last input that ``state`` contains.
    """

    state: State
    version: int
    repeat: int
    input: int


class FrameScheduler:
    """Holds the latest state only; earlier states that were never drawn are dropped."""

    def __init__(self, state: State) -> None:
        self._changed = Condition()
        self._state = self._last_drawable = state
        self._version = self._input = self._pages = 0
        self._drawn_version, self._repeat = -1, 0
        self._closed = False

    @property
    def state(self) -> State:
        """The latest state."""
        with self._changed:
            return self._state

    def update(self, change: Callable[[State], State], input_number: int = 0) -> None:
        """Replace the state by ``change(state)``, numbered by its input; if ``change`` raises, nothing changes."""
        with self._changed:
            state = change(self._state)
            self._input = input_number or self._input
            if state != self._state or input_number:
                self._state, self._version = state, self._version + 1
                self._changed.notify_all()

    def set_pages(self, pages: int) -> None:
        """Set the number of connected pages; nothing is drawn without any."""
        with self._changed:
            if pages > self._pages:
                self._version += 1  # so that a new page receives a frame
            self._pages = pages
            self._changed.notify_all()

    def take(self) -> FrameTask | None:
        """Wait for a frame to draw; None once the scheduler is closed."""
        with self._changed:
            self._changed.wait_for(self._has_work)
            if self._version == self._drawn_version and self._repeat == 0:
                self._changed.wait_for(self._is_new, REFINE_DELAY_SECONDS)
            if self._closed:
                return None
            self._repeat = self._repeat + 1 if self._version == self._drawn_version else 0
            self._drawn_version = self._version
            return FrameTask(self._state, self._version, self._repeat, self._input)

    def should_continue(self, task: FrameTask) -> bool:
        """Return whether to finish ``task``: always if it answers an input, otherwise until the next input."""
        with self._changed:
            return task.repeat == 0 or not self._changed.wait_for(self._is_new, YIELD_SECONDS)

    def confirm(self, task: FrameTask) -> None:
        """Record that the state of ``task`` could be drawn."""
        with self._changed:
            self._last_drawable = task.state

    def reject(self, task: FrameTask) -> None:
        """Record that the state of ``task`` can't be drawn: if it is the latest, return to the last drawable one."""
        with self._changed:
            if task.version == self._version:
                if self._state == self._last_drawable:
                    self._repeat = FRAMES_PER_STATE
                else:
                    self._state, self._version = self._last_drawable, self._version + 1

    def close(self) -> None:
        """End the wait of ``take``."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _is_new(self) -> bool:
        return self._closed or self._version != self._drawn_version

    def _has_work(self) -> bool:
        frames = FRAMES_PER_STATE if self._state.taa else 1
        return self._closed or (self._pages > 0 and (self._is_new() or self._repeat + 1 < frames))
