"""The thread that owns the OpenGL contexts: takes states from the scheduler, draws, and hands the frames on."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Thread
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from app.view.edited_scene import EditedScene
from app.view.encoder import jpeg, packed
from app.view.frame_scheduler import FrameScheduler, Task
from app.view.model_renderer import NEWEST, ModelRenderer
from app.view.state import FINAL, REFERENCE, Json, camera_json

REPORT_SECONDS = 0.5


@dataclass(frozen=True, eq=False)
class RenderedFrame:
    """A frame that was drawn.

    Attributes
    ----------
    message : bytes
        As it goes to the pages.
    radiance : list of ndarray, float32, shape (H, W, 3)
        The finished picture of each model, where it is compared with the reference.
    report : dict or None
        Times and what runs; every half a second.
    """

    task: Task
    message: bytes
    radiance: list[NDArray[np.float32]]
    report: Json | None


def _always() -> bool:
    return True


class RenderThread(Thread):
    """Draws until the scheduler closes.

    Parameters
    ----------
    deliver : callable
        Takes each frame; the next one is drawn when it returns, so that a frame leaves before new work begins.
    on_error : callable
        Takes the error of a state that can't be drawn.
    """

    def __init__(self, scheduler: FrameScheduler, stage: EditedScene, provider: str, folder: Path, deliver: Callable[[RenderedFrame], object],
                 on_error: Callable[[Exception], object]) -> None:
        super().__init__(name="render_thread", daemon=True)
        self._scheduler, self._deliver, self._on_error = scheduler, deliver, on_error
        self._renderers = [ModelRenderer(stage, provider, folder) for _ in range(2)]
        self._ends: deque[float] = deque(maxlen=NEWEST)
        self._reported = 0.0
        self._number = 0

    def run(self) -> None:
        with ExitStack() as stack:
            for drawing in self._renderers:
                stack.callback(drawing.close)
            while (task := self._scheduler.take()) is not None:
                try:
                    drawn = self._draw(task)
                except Exception as error:  # of the driver, too: the pages are told, and the last good state comes back
                    self._scheduler.refuse(task)
                    self._on_error(error)
                else:
                    if drawn is not None:
                        self._scheduler.accept(task)
                        self._deliver(drawn)

    def _draw(self, task: Task) -> RenderedFrame | None:
        """Nothing where an input came meanwhile, and the frame was none that answers one."""
        state = task.state
        wanted: Callable[[], bool] = partial(self._scheduler.wants, task)
        begin = perf_counter()
        used, unused = self._renderers[:len(state.models)], self._renderers[len(state.models):]
        for drawing in unused:
            drawing.close()
        for drawing, model in zip(used, state.models, strict=True):
            if not drawing.draw(state, model, wanted):
                return None
            wanted = _always  # given up now, the second would stay a frame behind the first
        parts = [jpeg(drawing.shown(state)) for drawing in used]
        self._number += 1
        if task.repeat == 0 and self._ends and begin - self._ends[-1] > 1:
            self._ends.clear()  # nothing was drawn meanwhile
        self._ends.append(perf_counter())
        header = {"kind": "frame", "number": self._number, "input": task.input, "repeat": task.repeat,
                  "size": state.size, "models": state.models, "camera": camera_json(state.camera)}
        judged = state.aov == FINAL and state.split == REFERENCE
        radiance = [drawing.radiance() for drawing in used] if judged else []
        return RenderedFrame(task, packed(header, parts), radiance, self._report())

    def _report(self) -> Json | None:
        now = perf_counter()
        if now - self._reported < REPORT_SECONDS:
            return None
        self._reported = now
        gaps = np.diff(self._ends)
        return {"fps": float(1 / np.median(gaps)) if len(gaps) else 0.0,
                "models": [report for d in self._renderers if (report := d.report())]}
