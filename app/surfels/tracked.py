"""The surfels of a renderer, which follow its camera or belong to given viewpoints.

They are placed at the first frame. Those that follow the camera are placed again when it leaves the surfaces that they
cover; those of viewpoints depend on these and the time alone, not on what was drawn before.
"""

from collections.abc import Callable, Sequence

import numpy as np

from app.arrays import F32, F64
from app.math3d import View
from app.network.channels import HALF_MAX
from app.raycast.caster import Caster
from app.scene import Scene
from app.surfels.lookup import SurfelLookup
from app.surfels.world import WorldSurfels

MIN_EYE_MOVE = 0.25  # median radii of surfels, before the eye's surroundings are tested again


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
        self._placed_from = self._tested_from = np.zeros(3)  # world space
        self._covers_own_eye = False
        self._viewpoints: tuple[Sequence[View], float] | None = None  # of which the surfels are, and the time
        self.version = 0
        self._lookup: tuple[int, SurfelLookup] | None = None

    @property
    def caster(self) -> Caster:
        """Casts rays at the scene; shared, so anyone may move it."""
        return self._caster()

    @property
    def lookup(self) -> SurfelLookup:
        """Interpolates between the surfels of ``world``."""
        if self._lookup is None or self._lookup[0] != self.version:
            self._lookup = self.version, SurfelLookup(self.world)
        return self._lookup[1]

    def arriving_light(self, indirect: F32) -> F32:
        """Irradiance / π at the surfels without that of lights, shape (S, 3): that of the sky, and ``indirect`` light.

        A network may have made the latter of what is no number; such surfels have none at all.
        """
        sent = self.world.sky_irradiance + indirect
        is_known = (sent < HALF_MAX).all(axis=1, keepdims=True)
        return np.asarray(np.where(is_known, sent, 0).clip(0), np.float32)

    def forget_lookup(self) -> None:
        """Begin the next lookup anew: what it remembers depends on the points that were looked up before."""
        self._lookup = None

    def update(self, view: View, time: float, viewpoints: Sequence[View] = ()) -> None:
        """Have surfels for what ``viewpoints`` see at ``time`` seconds, or without any, for what ``view`` sees."""
        if viewpoints:
            if self._viewpoints != (viewpoints, time):
                self._place(viewpoints, time)
                self._viewpoints = viewpoints, time
            return
        self._viewpoints = None
        if self.version == 0:
            self._place([view], time)
            return
        moved = self.world.move_to(time)
        self.version += moved
        if moved or self._is_farther(view, MIN_EYE_MOVE, self._tested_from):
            self._tested_from = view.eye
            if self._needs_others(view):
                self._place([view], time)

    def _needs_others(self, view: View) -> bool:
        """Whether newly placed surfels would serve the view better."""
        # Surfels that don't cover the eye they were placed from would otherwise be replaced in every frame.
        is_far = self._is_farther(view, 1.0, self._placed_from)
        return (is_far or self._covers_own_eye) and not self.world.covers(view.eye)

    def _is_farther(self, view: View, radii: float, point: F64) -> bool:
        """Whether the view's eye is more than so many median radii of the surfels away from a point in world space."""
        return float(np.linalg.norm(view.eye - point)) > radii * float(self.world.median_radius)

    def _place(self, views: Sequence[View], time: float) -> None:
        self.world = WorldSurfels(self._scene, self.caster, views, self.count, self.rays, time)
        self._placed_from = self._tested_from = views[0].eye
        self._covers_own_eye = self.world.covers(views[0].eye)
        self.version += 1
