"""The render thread: both sides of a split view show the same frame, whatever was abandoned."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.load import load_for_editing
from app.paths import data_dir
from app.view.edited_scene import EditedScene
from app.view.encoder import unpack_message
from app.view.frame_scheduler import FrameScheduler, FrameTask
from app.view.render_thread import RenderThread
from app.view.state import State

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

BOX = data_dir() / "cornell-box.obj"
MAX_PASSES = 20  # more than two models have


class InterruptingScheduler(FrameScheduler):
    """Interrupts a frame after a number of passes."""

    passes_left = MAX_PASSES

    def should_continue(self, task: FrameTask) -> bool:
        self.passes_left -= 1
        return self.passes_left >= 0


def test_an_abandoned_frame_leaves_both_sides_in_step(tmp_path: Path) -> None:
    loaded = load_for_editing(BOX)
    camera = loaded.scene.cameras[loaded.scene.default_camera].at(0.0)
    state = State((64, 48), camera, loaded.scene.lights, "none", split="none")
    scheduler = InterruptingScheduler(state)
    thread = RenderThread(scheduler, EditedScene(BOX, loaded, tmp_path), "cpu", pytest.fail, pytest.fail)
    abandoned = 0
    for passes in range(MAX_PASSES):
        scheduler.passes_left = passes
        abandoned += thread._draw(FrameTask(state, 0, 1, 0)) is None
        scheduler.passes_left = MAX_PASSES
        frame = thread._draw(FrameTask(state, 0, 2, 0))
        assert frame is not None
        left, right = unpack_message(frame.message)[1]
        assert left == right
    assert abandoned
    for renderer in thread._renderers:
        renderer.close()
