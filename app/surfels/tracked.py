"""The surfels of a renderer: placed at the first frame, and again when the camera leaves the surfaces they cover."""

from collections.abc import Callable

import numpy as np

from app.math3d import View
from app.raycast.caster import Caster
from app.scene import Scene
from app.surfels.world import WorldSurfels


class TrackedSurfels:
    """``count`` surfels with ``rays`` rays each.

    Parameters
    ----------
    caster : callable
        Gives the caster of the scene, which may be shared.

    Attributes
    ----------
    world : WorldSurfels
        Set by the first ``update``.
    version : int
        Changes whenever anything of ``world`` does.
    """

    world: WorldSurfels

    def __init__(self, scene: Scene, caster: Callable[[], Caster], count: int, rays: int) -> None:
        self._scene, self._caster, self.count, self.rays = scene, caster, count, rays
        self._placed_from, self._eye = np.zeros(3), np.zeros(3)
        self._covers_own_eye = False
        self.version = 0

    @property
    def caster(self) -> Caster:
        """Casts rays at the scene; shared, so anyone may move it."""
        return self._caster()

    def update(self, view: View, time: float) -> None:
        """Have surfels for what ``view`` sees at ``time`` seconds."""
        if self.version == 0:
            self._place(view, time)
            return
        moved = self.world.move_to(time)
        self.version += moved
        if (moved or not np.array_equal(view.eye, self._eye)) and self._needs_others(view):
            self._place(view, time)
        self._eye = view.eye

    def _needs_others(self, view: View) -> bool:
        """Whether newly placed surfels would serve the view better."""
        # Surfels that don't cover the eye they were placed from would otherwise be replaced in every frame.
        far = float(np.linalg.norm(view.eye - self._placed_from)) > float(np.median(self.world.radius))
        return (far or self._covers_own_eye) and not self.world.covers(view.eye)

    def _place(self, view: View, time: float) -> None:
        self.world = WorldSurfels(self._scene, self.caster, view, self.count, self.rays, time)
        self._placed_from = self._eye = view.eye
        self._covers_own_eye = self.world.covers(view.eye)
        self.version += 1
