"""Draws tasks, with one renderer for as many as it suits."""

from __future__ import annotations

import json
from itertools import islice
from pathlib import Path
from typing import Any

from app.api.frame import Frame
from app.api.renderer import Renderer
from app.api.scene import Scene, load
from app.batch.jobs import LEAD_IN, Job, Task
from app.io.atomic_files import write_text
from app.load import parse_camera
from app.network.selection import NONE

FRAME_SECONDS = 1 / 30


class TaskDrawer:
    """Keeps the scene and the renderer of the task before, if the next one needs the same."""

    def __init__(self) -> None:
        self._key: object = None
        self._renderer: Renderer | None = None

    def draw(self, task: Task, out: Path) -> None:
        """Draw a task, write its pictures into the folder ``out``, and last the record that it is done."""
        if task.is_done(out):
            return  # by a worker that died before it could say so
        key = task.key()  # of the files before they are read: if they change meanwhile, the task is drawn again
        job, folder = task.job, out / task.job.name
        folder.mkdir(parents=True, exist_ok=True)
        renderer = self._renderer_for(job)
        if task.camera is None:
            cameras = [_camera(job, index) for index in range(len(job.cameras))]
            for index, frame in renderer.iterate_batch(cameras, job.time):
                _write(frame, folder / f"{index:03d}", job)
        else:
            self._draw_chunk(renderer, task, folder / f"{task.camera:03d}")
        write_text(out / task.record, json.dumps({"key": key}) + "\n")

    def _draw_chunk(self, renderer: Renderer, task: Task, folder: Path) -> None:
        assert task.camera is not None
        folder.mkdir(exist_ok=True)
        lead_in = min(LEAD_IN, task.first)
        numbers = range(task.first - lead_in, task.last + 1)  # the last one is not drawn, but what flow leads to
        cameras = [_camera(task.job, task.camera)] * len(numbers)
        times = [task.job.time + number * FRAME_SECONDS for number in numbers]
        frames = islice(renderer.render_video(cameras, times, lead_in), task.last - task.first)
        for number, frame in enumerate(frames, task.first):
            _write(frame, folder / f"{number:04d}", task.job)

    def _renderer_for(self, job: Job) -> Renderer:
        key = job.renderer_settings, job.files_digest()
        if self._renderer is None or key != self._key:
            self.close()
            scene: Scene = load(job.scene, lighting=job.lighting)
            self._renderer = Renderer(scene, job.size, None if job.model == NONE else job.model, outputs=job.outputs,
                                      tonemap=job.tonemap)
            self._key = key
        self._renderer.exposure = job.exposure
        return self._renderer

    def close(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = None


def _camera(job: Job, index: int) -> Any:
    camera = job.cameras[index]
    return parse_camera(camera, f"{job.name}: cameras[{index}]") if isinstance(camera, dict) else camera


def _write(frame: Frame, stem: Path, job: Job) -> None:
    for suffix in job.formats:
        frame.save(stem.with_name(f"{stem.name}.{suffix}"))
