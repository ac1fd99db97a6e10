"""The surfels that a renderer uses: made at the first frame, and made anew where the camera goes out of their sight."""

from __future__ import annotations

import numpy as np

from app.math3d import View
from app.raycast.body import embree
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

    Raises
    ------
    DeviceError
        Where rays can't be traced.
    """

    world: WorldSurfels

    def __init__(self, scene: Scene, count: int, rays: int) -> None:
        embree()
        self._scene, self.count, self.rays = scene, count, rays
        self._made_at, self._eye = np.zeros(3), np.zeros(3)
        self._covered = False
        self.version = 0

    def follow(self, view: View, time: float) -> None:
        """Have surfels for what ``view`` sees at ``time`` seconds."""
        if self.version == 0:
            self._make(view, time)
            return
        moved = self.world.place(time)
        self.version += moved
        if (moved or not np.array_equal(view.eye, self._eye)) and self._left(view):
            self._make(view, time)
        self._eye = view.eye

    def _left(self, view: View) -> bool:
        """Whether other surfels would serve the view better."""
        # Where new ones did not cover their own place, they would be made again and again.
        far = float(np.linalg.norm(view.eye - self._made_at)) > float(np.median(self.world.radius))
        return (far or self._covered) and not self.world.covers(view.eye)

    def _make(self, view: View, time: float) -> None:
        self.world = WorldSurfels(self._scene, view, self.count, self.rays, time)
        self._made_at = self._eye = view.eye
        self._covered = self.world.covers(view.eye)
        self.version += 1
