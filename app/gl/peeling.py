"""Layers of blended and transmissive surfaces, as passes share them: where on the screen they are, if at all."""

from collections.abc import Iterator
from contextlib import contextmanager

import moderngl
import numpy as np

from app.arrays import F64
from app.gl.context import Device
from app.gl.frame_state import FrameState

Rect = tuple[int, int, int, int]  # x, y, width and height in texels, y up


class PeeledLayer:
    """One layer, 0 for the nearest.

    Attributes
    ----------
    prefix : str
        Of the names of its resources and passes.
    """

    def __init__(self, index: int) -> None:
        self.index, self.prefix = index, f"peel{index}_"
        self._query: moderngl.Query | None = None

    @contextmanager
    def watch(self, device: Device) -> Iterator[None]:
        """Note whether anything that is drawn here is visible."""
        if self._query is None:
            self._query = device.ctx.query(samples=True)
        with self._query:
            yield

    @property
    def is_visible(self) -> bool:
        """Whether any pixel has the layer; waits for the GPU to have drawn it."""
        assert self._query is not None, "the layer has not been drawn"
        return bool(self._query.samples)

    @contextmanager
    def within(self, target: moderngl.Framebuffer, frame: FrameState) -> Iterator[None]:
        """Draw into ``target`` only where the layer may be, and nothing if no pixel has it; the GPU decides that."""
        assert self._query is not None and self._query.crender is not None, "the layer has not been drawn"
        target.scissor = see_through_rect(frame)
        with self._query.crender:
            yield
        target.scissor = 0, 0, *target.size


def see_through_rect(frame: FrameState) -> Rect:
    """The part of the image around all blended and transmissive surfaces."""
    clip, eye = frame.view.clip_from_relative(frame.jitter), frame.view.eye
    visible = frame.geometry.visible(clip, eye) & frame.geometry.is_see_through
    if not visible.any():
        return 0, 0, 0, 0
    boxes = frame.geometry.boxes[visible] - eye
    corners = np.stack([boxes[:, choice, range(3)] for choice in np.ndindex(2, 2, 2)], axis=1).reshape(-1, 3)
    projected: F64 = np.concatenate([corners, np.ones_like(corners[:, :1])], axis=1) @ clip.T
    size = np.array(frame.size)
    if (projected[:, 3] <= frame.view.near).any():
        return 0, 0, frame.size[0], frame.size[1]
    at = np.clip((projected[:, :2] / projected[:, 3:] * 0.5 + 0.5) * size, 0, size)
    (x0, y0), (x1, y1) = np.floor(at.min(axis=0)).astype(int), np.ceil(at.max(axis=0)).astype(int)
    return int(x0), int(y0), int(x1 - x0), int(y1 - y0)
