"""What is seen, as files: drawn afresh by the command that is told with them, so that it gives the same bytes again."""

from __future__ import annotations

import asyncio
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path

from app.load import Parts
from app.view.model_renderer import shown_outputs
from app.view.process import run_module
from app.view.scene_file import arguments, write_scene_json
from app.view.state import State

SCENE_JSON = "afterglow.json"
SETTLE = 16
FORMATS = ("json", "png", "exr")
MAX_KEPT = 8  # that can be fetched; older ones are deleted


@dataclass(frozen=True)
class Saved:
    """A file for the page to fetch by its number, and the command that makes it again from the scene JSON."""

    number: int
    file: Path
    command: str


class Saver:
    """Keeps what was saved last in ``folder``, a new one inside it for each call."""

    def __init__(self, scene: Path, parts: Parts, folder: Path, provider: str) -> None:
        self._scene, self._parts, self._folder, self._provider = scene, parts, folder, provider
        self._count = 0
        self._kept: dict[int, Saved] = {}

    async def save(self, state: State, kind: str, settle: int = SETTLE) -> Saved:
        """Save ``state`` as one of ``FORMATS``: its scene JSON, a PNG of what is shown, or an EXR with all AOVs.

        Raises
        ------
        AfterglowError
            When it can't be drawn or written.
        """
        self._count += 1
        folder = self._folder / str(self._count)
        folder.mkdir(parents=True)
        try:
            saved = await self._made(state, kind, settle, folder)
        except BaseException:
            shutil.rmtree(folder)
            raise
        self._kept[saved.number] = saved
        if len(self._kept) > MAX_KEPT:
            oldest = self._kept.pop(next(iter(self._kept)))
            await asyncio.to_thread(shutil.rmtree, oldest.file.parent)
        return saved

    def file(self, number: int) -> Path | None:
        """What was saved under that number, as long as it is kept."""
        return self._kept[number].file if number in self._kept else None

    async def _made(self, state: State, kind: str, settle: int, folder: Path) -> Saved:
        write_scene_json(folder / SCENE_JSON, state, self._parts)
        aovs = shown_outputs() if kind == "exr" else (state.aov,)
        formats = "exr,png" if kind == "json" else kind

        def told(file: Path | str) -> list[str]:
            return arguments(state, self._scene, file, settle, aovs, formats, self._provider)

        if kind != "json":
            await run_module("app", [*told(folder / SCENE_JSON), "--out", str(folder)])
        file = folder / (SCENE_JSON if kind == "json" else f"0000.{kind}")
        return Saved(self._count, file, shlex.join(["python", "-m", "app", *told(SCENE_JSON)]))
