"""What the tracers draw: a scene seen by one camera at one time."""

from __future__ import annotations

from dataclasses import dataclass

from app.math3d import View
from app.scene import Camera, Scene

RAYS_AT_ONCE = 2**20  # as many as fit into memory


@dataclass(frozen=True, eq=False)
class Still:
    """A scene seen by one camera in an image ``size`` of width and height, at ``time`` seconds."""

    scene: Scene
    camera: Camera
    size: tuple[int, int]
    time: float = 0.0

    @property
    def view(self) -> View:
        return View.of(self.camera, self.size, 1e-4 * self.scene.longest_edge)
