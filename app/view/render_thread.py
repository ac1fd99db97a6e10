"""The thread that owns the OpenGL contexts: it takes states from the scheduler, draws, and delivers frames."""

from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from threading import Thread
from time import perf_counter

import numpy as np

from app.arrays import F32
from app.renderer import always
from app.view.edited_scene import EditedScene
from app.view.encoder import encode_jpeg, pack_message
from app.view.frame_scheduler import FrameScheduler, FrameTask
from app.view.model_renderer import MAX_TIMED_FRAMES, ModelRenderer
from app.view.motion_scale import MotionScale
from app.view.state import FINAL, REFERENCE, Json, camera_to_json

STATS_SECONDS = 0.5  # between two reports


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """A frame that was drawn.

    Attributes
    ----------
    message : bytes
        The binary message for the pages.
    radiance : list of ndarray, float32, shape (H, W, 3)
        The final image of each model, if it is compared with the reference; otherwise empty.
    stats : dict or None
        Frame rate, pass times and device, every ``STATS_SECONDS``.
    """

    task: FrameTask
    message: bytes
    radiance: list[F32]
    stats: Json | None


class RenderThread(Thread):
    """Draws until the scheduler is closed.

    Parameters
    ----------
    deliver : callable
        Receives each frame. The next frame starts when it returns, so that a frame is sent before new work begins.
    on_error : callable
        Receives the error of a state that can't be drawn.
    target_fps : float
        Frames per second to reach while something moves, by drawing smaller ones; 0 to draw all at full size.
    """

    def __init__(self, scheduler: FrameScheduler, edited_scene: EditedScene, provider: str,
                 deliver: Callable[[RenderedFrame], object], on_error: Callable[[Exception], object],
                 target_fps: float = 0.0) -> None:
        super().__init__(name="render_thread", daemon=True)
        self._scheduler, self._deliver, self._on_error = scheduler, deliver, on_error
        self._renderers = [ModelRenderer(edited_scene, provider) for _ in range(2)]
        self._motion_scale = MotionScale(target_fps)
        self._frame_ends: deque[float] = deque(maxlen=MAX_TIMED_FRAMES)
        self._last_stats = 0.0
        self._number = 0

    def run(self) -> None:
        with ExitStack() as stack:
            for renderer in self._renderers:
                stack.callback(renderer.close)
            while (task := self._scheduler.take()) is not None:
                try:
                    frame = self._draw(task)
                except Exception as error:  # any error, those of the driver included: the last drawable state returns
                    self._scheduler.reject(task)
                    self._on_error(error)
                else:
                    if frame is not None:
                        self._scheduler.confirm(task)
                        self._deliver(frame)

    def _draw(self, task: FrameTask) -> RenderedFrame | None:
        """Draw a frame; None if it was abandoned because an input arrived."""
        state = task.state
        should_continue: Callable[[], bool] = partial(self._scheduler.should_continue, task)
        begin = perf_counter()
        used, unused = self._renderers[:len(state.models)], self._renderers[len(state.models):]
        for renderer in unused:
            renderer.close()
        answers_input = task.repeat == 0
        render_scale = self._motion_scale.scale if answers_input else 1.0
        for renderer, model in zip(used, state.models, strict=True):
            if not renderer.draw(state, model, should_continue, render_scale):
                return None
            should_continue = always  # abandoning the second model's frame would leave it one frame behind the first
        files = [encode_jpeg(renderer.read_display(state)) for renderer in used]
        if answers_input:
            self._motion_scale.measure(perf_counter() - begin)
        self._number += 1
        if answers_input and self._frame_ends and begin - self._frame_ends[-1] > 1:
            self._frame_ends.clear()  # exclude the idle time from the frame rate
        self._frame_ends.append(perf_counter())
        header = {"kind": "frame", "number": self._number, "input": task.input, "repeat": task.repeat,
                  "size": state.size, "models": state.models, "camera": camera_to_json(state.camera)}
        compared = state.aov == FINAL and state.split == REFERENCE
        radiance = [renderer.read_radiance() for renderer in used] if compared else []
        return RenderedFrame(task, pack_message(header, files), radiance, self._collect_stats())

    def _collect_stats(self) -> Json | None:
        now = perf_counter()
        if now - self._last_stats < STATS_SECONDS:
            return None
        self._last_stats = now
        intervals = np.diff(self._frame_ends)
        return {"fps": float(1 / np.median(intervals)) if len(intervals) else 0.0,
                "models": [stats for renderer in self._renderers if (stats := renderer.collect_stats())]}
