"""The render_thread: both sides of a split view are of the same frame, whatever was given up."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.load import load_parts
from app.paths import data_dir
from app.view.edited_scene import EditedScene
from app.view.encoder import unpacked
from app.view.frame_scheduler import FrameScheduler, Task
from app.view.render_thread import RenderThread
from app.view.state import State

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl", "coarse_shadows")]

BOX = data_dir() / "cornell-box.obj"
MOST = 20  # passes, more than two models have


class WantedFor(FrameScheduler):
    """Says yes so many times."""

    left = MOST

    def wants(self, task: Task) -> bool:
        self.left -= 1
        return self.left >= 0


def test_a_frame_that_is_given_up_leaves_both_sides_in_step(tmp_path: Path) -> None:
    parts = load_parts(BOX)
    camera = parts.scene.cameras[parts.scene.default_camera].at(0.0)
    state = State((64, 48), camera, parts.scene.lights, "none", split="none")
    scheduler = WantedFor(state)
    render_thread = RenderThread(scheduler, EditedScene(BOX, parts, tmp_path), "cpu", tmp_path, pytest.fail, pytest.fail)
    given_up = 0
    for passes in range(MOST):
        scheduler.left = passes
        given_up += render_thread._draw(Task(state, 0, 1, 0)) is None
        scheduler.left = MOST
        drawn = render_thread._draw(Task(state, 0, 2, 0))
        assert drawn is not None
        left, right = unpacked(drawn.message)[1]
        assert left == right
    assert given_up
    for drawing in render_thread._renderers:
        drawing.close()
