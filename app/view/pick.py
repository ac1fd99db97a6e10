"""What is at a point of the image, and where the eye may go: rays on the CPU, so that the render thread goes on."""

from dataclasses import dataclass, replace
from threading import Lock

import numpy as np

from app.load import LoadedScene
from app.math3d import View, translation
from app.raycast.caster import Caster
from app.scene import Scene
from app.view.orbit import Orbit, plan_orbit
from app.view.state import State, Vec


@dataclass(frozen=True)
class PickHit:
    """A point in world space and the name of the object it lies on, empty if that has none."""

    point: Vec
    object: str


class Picker:
    """Casts rays into the scene of the latest state; rebuilds its bodies when an object or the time has changed."""

    def __init__(self, loaded: LoadedScene) -> None:
        self._loaded = loaded
        self._caster: Caster | None = None
        self._moved: object = None
        self._lock = Lock()  # for the bodies

    def pick(self, state: State, position: tuple[float, float]) -> PickHit | None:
        """Return what is visible at ``position``, from (0, 0) upper left to (1, 1) lower right; None for the sky."""
        caster, view = self._caster_of(state), View.of(state.camera, state.size, 1.0)
        offsets, directions = view.rays(np.array([[2 * position[0] - 1, 1 - 2 * position[1]]]))
        origins = view.eye - caster.origin + offsets
        hits = caster.cast(origins.astype(np.float32), directions.astype(np.float32))
        if hits.body[0] < 0:
            return None
        x, y, z = (hits.position[0] + caster.origin).tolist()
        return PickHit((x, y, z), self._object_of(int(caster.instance_of(hits)[0])))

    def plan_orbit(self, state: State, pivot: Vec) -> Orbit | None:
        """Return where the eye of the state's camera may go about ``pivot``; None where walls are all around it."""
        return plan_orbit(self._caster_of(state), state.camera, np.array(pivot))

    def _caster_of(self, state: State) -> Caster:
        moved = state.object_offsets, state.time
        with self._lock:
            if self._caster is None or moved != self._moved:
                self._caster, self._moved = Caster(_move_objects(self._loaded, state)), moved
                self._caster.move_to(state.time)
            return self._caster

    def _object_of(self, instance: int) -> str:
        """Return the smallest object that contains the instance."""
        objects = [(len(members), name) for name, members in self._loaded.objects.items() if instance in members]
        return min(objects)[1] if objects else ""


def _move_objects(loaded: LoadedScene, state: State) -> Scene:
    """The scene with all instances where they are at the state's time; shapes are still those of any time."""
    offsets = {i: offset for name, offset in state.object_offsets for i in loaded.objects[name]}
    transforms = (translation(np.asarray(offsets.get(i, (0.0, 0.0, 0.0)))) @ instance.transform_at(state.time)
                  for i, instance in enumerate(loaded.scene.instances))
    return replace(loaded.scene, instances=tuple(
        replace(instance, transform=transform, placement=None, motion=None)
        for instance, transform in zip(loaded.scene.instances, transforms, strict=True)))
