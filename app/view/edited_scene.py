"""The scene with the user's edits: other lights and moved objects."""

from pathlib import Path

from app.load import LoadedScene, load_for_editing
from app.scene import Scene
from app.view.scene_file import write_scene_json
from app.view.state import State

TIME_STEP = 1e-6  # seconds added to the clock when an object has moved, so that renderers update its transform


class EditedScene:
    """Applies a state to the scene; reloads the scene only when the set of moved objects changes.

    Attributes
    ----------
    loaded : LoadedScene
        The scene as its files describe it.
    time : float
        Seconds to be added to the state's; increases by ``TIME_STEP`` whenever an object has moved.
    """

    def __init__(self, file: Path, loaded: LoadedScene, folder: Path) -> None:
        self.loaded, self.time = loaded, 0.0
        self._file, self._json = file, folder / "edited.json"
        self._edited = loaded
        self._moved: tuple[str, ...] = ()
        self._offsets: object = ()

    def apply(self, state: State) -> Scene:
        """Return the scene of ``state``.

        Raises
        ------
        SceneError
            When the loader rejects it.
        """
        names = tuple(name for name, _ in state.object_offsets)
        if names != self._moved:
            write_scene_json(self._json, state, self.loaded)
            self._edited = self._reload() if names else self.loaded
            self._moved, self._offsets = names, state.object_offsets
        if state.object_offsets != self._offsets:
            self._write_offsets(state)
        derived = self._edited.scene.lights[self._edited.own_lights:]
        return self._edited.scene.with_lights(*state.lights, *derived)

    @property
    def moved_objects(self) -> tuple[str, ...]:
        """Names of the objects that can move without reloading the scene."""
        return self._moved

    def _reload(self) -> LoadedScene:
        return load_for_editing(self._file, scene_json=self._json, variant=self.loaded.variant,
                                animation=self.loaded.animation)

    def _write_offsets(self, state: State) -> None:
        """Write the offsets into the motions that renderers hold."""
        for name, offset in state.object_offsets:
            for index in self._edited.objects[name]:
                motion = self._edited.scene.instances[index].motion
                assert motion is not None
                motion.transforms[0, :3, 3] = offset
        self._offsets = state.object_offsets
        self.time += TIME_STEP
