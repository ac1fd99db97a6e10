"""What is seen at a place of the picture: one ray on the CPU, so that the render_thread need not stop."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from app.load import Parts
from app.math3d import View, translation
from app.raycast.caster import Caster
from app.scene import F64, Motion, Scene
from app.view.state import State, Vec


@dataclass(frozen=True)
class Picked:
    """A point in world space, and the object that it is on, if that has a name."""

    point: Vec
    object: str


class Picker:
    """Casts rays at the scene of the newest state; made anew when an object has moved."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        self._caster: Caster | None = None
        self._places: object = None

    def pick(self, state: State, at: tuple[float, float]) -> Picked | None:
        """What the camera sees ``at`` a place, from (0, 0) at the upper left to (1, 1); None for the sky."""
        if self._caster is None or state.places != self._places:
            self._caster, self._places = Caster(_each_alone(self._parts, state)), state.places
        view = View.of(state.camera, state.size, 1.0)
        x, y = (2 * at[0] - 1) * view.tan_half[0], (1 - 2 * at[1]) * view.tan_half[1]
        direction = np.array([x, y, -1.0]) @ view.rotation
        origin = (view.eye - self._caster.origin).astype(np.float32)
        hits = self._caster.cast(origin[None], direction[None].astype(np.float32))
        if hits.body[0] < 0:
            return None
        x, y, z = (hits.position[0] + self._caster.origin).tolist()
        return Picked((x, y, z), self._name(self._caster.dynamic_instances[int(hits.body[0]) - 1]))

    def _name(self, instance: int) -> str:
        """The smallest object that the instance belongs to."""
        objects = [(len(members), name) for name, members in self._parts.objects.items() if instance in members]
        return min(objects)[1] if objects else ""


def _each_alone(parts: Parts, state: State) -> Scene:
    """The scene with a motion for every instance, which says where it is, so that each is a body of its own."""
    still = np.eye(4)
    places = {i: translation(np.asarray(place)) for name, place in state.places for i in parts.objects[name]}
    return replace(parts.scene, instances=tuple(
        replace(instance, motion=Motion(np.zeros(1), (places.get(i, still) @ _rest(instance.motion))[None]))
        for i, instance in enumerate(parts.scene.instances)))


def _rest(motion: Motion | None) -> F64:
    return np.eye(4) if motion is None else motion.transforms[0]
