"""The surfels that a renderer uses: made at the first frame, and made anew where the camera goes out of their sight."""

from __future__ import annotations

from app.math3d import View
from app.scene import Scene
from app.surfels.world import WorldSurfels


class TrackedSurfels:
    """``count`` surfels with ``rays`` rays each.

    Attributes
    ----------
    world : WorldSurfels
        After the first ``follow``.
    version : int
        Another one whenever anything of ``world`` has changed.
    """

    world: WorldSurfels

    def __init__(self, scene: Scene, count: int, rays: int) -> None:
        self._scene, self.count, self.rays = scene, count, rays
        self._eye: object = None
        self.version = 0

    def follow(self, view: View, time: float) -> None:
        """Have surfels for what ``view`` sees at ``time`` seconds."""
        eye = tuple(view.eye)
        if self.version == 0:
            self._make(view, time)
        else:
            if self.world.place(time):
                self.version += 1
            if eye != self._eye and not self.world.covers(view.eye):
                self._make(view, time)
        self._eye = eye

    def _make(self, view: View, time: float) -> None:
        self.world = WorldSurfels(self._scene, view, self.count, self.rays, time)
        self.version += 1
