"""Saves the view as files, rendered by the command that is shown with them, so that it reproduces the same bytes."""

import asyncio
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path

from app.io.child_process import run_module_async
from app.load import LoadedScene
from app.paths import PROGRAM
from app.settings import SETTLE_FRAMES
from app.view.model_renderer import VIEWABLE_OUTPUTS
from app.view.scene_file import render_arguments, write_scene_json
from app.view.state import State

SCENE_JSON = "afterglow.json"
MAX_SAVED = 8  # files that can be downloaded; older ones are deleted


@dataclass(frozen=True)
class SavedFile:
    """A file that the page can download by its number, and the command that renders it from the scene JSON."""

    number: int
    path: Path
    command: str


class Saver:
    """Saves each file in a new folder inside ``folder`` and keeps the latest ones."""

    def __init__(self, scene: Path, loaded: LoadedScene, folder: Path, provider: str) -> None:
        self._scene, self._loaded, self._folder, self._provider = scene, loaded, folder, provider
        self._count = 0
        self._saved: dict[int, SavedFile] = {}

    async def save(self, state: State, kind: str, settle: int = SETTLE_FRAMES) -> SavedFile:
        """Save ``state`` as ``json`` (scene JSON), ``png`` (the shown image) or ``exr`` (all AOVs).

        Raises
        ------
        AfterglowError
            When it can't be rendered or written.
        """
        self._count += 1
        folder = self._folder / str(self._count)
        folder.mkdir(parents=True)
        try:
            saved = await self._write(state, kind, settle, folder)
        except BaseException:
            shutil.rmtree(folder)
            raise
        self._saved[saved.number] = saved
        if len(self._saved) > MAX_SAVED:
            oldest = self._saved.pop(next(iter(self._saved)))
            await asyncio.to_thread(shutil.rmtree, oldest.path.parent)
        return saved

    def find(self, number: int) -> Path | None:
        """Return the file saved under ``number``; None if there is none, or it was deleted."""
        return self._saved[number].path if number in self._saved else None

    async def _write(self, state: State, kind: str, settle: int, folder: Path) -> SavedFile:
        write_scene_json(folder / SCENE_JSON, state, self._loaded)
        aovs = VIEWABLE_OUTPUTS if kind == "exr" else (state.aov,)
        formats = "exr,png" if kind == "json" else kind

        def arguments(scene_json: Path | str) -> list[str]:
            return render_arguments(state, self._scene, scene_json, settle, aovs, formats, self._provider,
                                    self._loaded.animation, self._loaded.variant)

        if kind != "json":
            await run_module_async(PROGRAM, [*arguments(folder / SCENE_JSON), "--out", str(folder)])
        path = folder / (SCENE_JSON if kind == "json" else f"0000.{kind}")
        return SavedFile(self._count, path, shlex.join(["python", "-m", PROGRAM, *arguments(SCENE_JSON)]))
