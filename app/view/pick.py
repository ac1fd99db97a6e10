"""Mouse picking: one ray cast on the CPU, so that the render thread is not interrupted."""

from dataclasses import dataclass, replace

import numpy as np

from app.arrays import F64
from app.load import LoadedScene
from app.math3d import View, translation
from app.raycast.caster import Caster
from app.scene import Motion, Scene
from app.view.state import State, Vec


@dataclass(frozen=True)
class PickHit:
    """A point in world space and the name of the object it lies on, empty if that has none."""

    point: Vec
    object: str


class Picker:
    """Casts rays into the scene of the latest state; rebuilds its bodies when an object has moved."""

    def __init__(self, loaded: LoadedScene) -> None:
        self._loaded = loaded
        self._caster: Caster | None = None
        self._offsets: object = None

    def pick(self, state: State, position: tuple[float, float]) -> PickHit | None:
        """Return what is visible at ``position``, from (0, 0) upper left to (1, 1) lower right; None for the sky."""
        if self._caster is None or state.object_offsets != self._offsets:
            self._caster, self._offsets = Caster(_separate_instances(self._loaded, state)), state.object_offsets
        view = View.of(state.camera, state.size, 1.0)
        x, y = (2 * position[0] - 1) * view.tan_half[0], (1 - 2 * position[1]) * view.tan_half[1]
        direction = np.array([x, y, -1.0]) @ view.rotation
        origin = (view.eye - self._caster.origin).astype(np.float32)
        hits = self._caster.cast(origin[None], direction[None].astype(np.float32))
        if hits.body[0] < 0:
            return None
        x, y, z = (hits.position[0] + self._caster.origin).tolist()
        return PickHit((x, y, z), self._object_of(self._caster.dynamic_instances[int(hits.body[0]) - 1]))

    def _object_of(self, instance: int) -> str:
        """Return the smallest object that contains the instance."""
        objects = [(len(members), name) for name, members in self._loaded.objects.items() if instance in members]
        return min(objects)[1] if objects else ""


def _separate_instances(loaded: LoadedScene, state: State) -> Scene:
    """Give every instance a motion that holds its current transform, so that each becomes a body of its own."""
    offsets = {i: offset for name, offset in state.object_offsets for i in loaded.objects[name]}
    transforms = (translation(np.asarray(offsets.get(i, (0.0, 0.0, 0.0)))) @ _first_key(instance.motion)
                  for i, instance in enumerate(loaded.scene.instances))
    return replace(loaded.scene, instances=tuple(
        replace(instance, motion=Motion(np.zeros(1), transform[None]))
        for instance, transform in zip(loaded.scene.instances, transforms, strict=True)))


def _first_key(motion: Motion | None) -> F64:
    return np.eye(4) if motion is None else motion.transforms[0]
