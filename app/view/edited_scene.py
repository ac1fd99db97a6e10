"""The scene as it is edited: other lights, and objects in other places."""

from __future__ import annotations

from pathlib import Path

from app.load import Parts, load_parts
from app.scene import Scene
from app.view.scene_file import write_scene_json
from app.view.state import State

MOMENT = 1e-6  # seconds by which the clock goes on when an object was moved, so that renderers place things anew


class EditedScene:
    """Loads the scene again only when another object begins to move.

    Attributes
    ----------
    parts : Parts
        The scene as its files have it.
    time : float
        Seconds; a moment later whenever an object has moved.
    """

    def __init__(self, file: Path, parts: Parts, folder: Path) -> None:
        self.parts, self.time = parts, 0.0
        self._file, self._json = file, folder / "stage.json"
        self._edited = parts
        self._movable: tuple[str, ...] = ()
        self._placed: object = ()

    def scene(self, state: State) -> Scene:
        """The scene of ``state``.

        Raises
        ------
        SceneError
            When the loader does not take it.
        """
        names = tuple(name for name, _ in state.places)
        if names != self._movable:
            write_scene_json(self._json, state, self.parts)
            self._edited = load_parts(self._file, scene_json=self._json) if names else self.parts
            self._movable, self._placed = names, state.places
        if state.places != self._placed:
            self._move(state)
        emitters = self._edited.scene.lights[self._edited.own_lights:]
        return self._edited.scene.with_lights(*state.lights, *emitters)

    @property
    def movable(self) -> tuple[str, ...]:
        """Objects that the scene of the newest state can move without being loaded again."""
        return self._movable

    def _move(self, state: State) -> None:
        """Write the places into the motions that renderers hold."""
        for name, place in state.places:
            for index in self._edited.objects[name]:
                motion = self._edited.scene.instances[index].motion
                assert motion is not None
                motion.transforms[0, :3, 3] = place
        self._placed = state.places
        self.time += MOMENT
