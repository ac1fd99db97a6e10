"""What the tracers render: a scene seen by one camera at one time."""

from dataclasses import dataclass

from app.math3d import View
from app.scene import Camera, Scene


@dataclass(frozen=True, eq=False)
class Still:
    """A scene seen by ``camera`` at ``time`` seconds, in an image of ``size`` (width, height)."""

    scene: Scene
    camera: Camera
    size: tuple[int, int]
    time: float = 0.0

    @property
    def view(self) -> View:
        return View.of(self.camera, self.size, 1e-4 * self.scene.longest_edge)
