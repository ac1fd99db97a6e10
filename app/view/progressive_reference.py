"""The path-traced reference of what is seen, refined in the background while nothing moves, and kept per camera."""

from __future__ import annotations

import asyncio
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from app.evaluation.hashing import content_key
from app.evaluation.reference import Reference, exporter_version, read_reference
from app.io.atomic_files import write_text
from app.io.image import write_exr
from app.load import Parts
from app.view.process import run_module
from app.view.scene_file import NAME, write_scene_json
from app.view.state import FINAL, REFERENCE, State

SAMPLES = (8, 24, 96, 384)  # per pixel, that one refinement after the other adds
REST_SECONDS = 0.7          # for which nothing moves before a reference is begun, or gone on with
MAX_KEPT = 64


class ReferenceTracer:
    """Traces the reference of the newest state.

    Parameters
    ----------
    tell : callable
        Takes each reference as soon as it is there, or None when there is none for what is seen now.
    on_error : callable
        Takes what went wrong.

    Attributes
    ----------
    newest : Reference or None
        That of the state that was followed last.
    """

    def __init__(self, file: Path, parts: Parts, folder: Path, tell: Callable[[Reference | None], object],
                 on_error: Callable[[Exception], object]) -> None:
        self._file, self._parts, self._folder = file, parts, folder
        self._tell, self._on_error = tell, on_error
        self._kept: dict[str, tuple[int, Path]] = {}  # how refined it is, and where
        self._key, self._failed = "", False
        self._work: asyncio.Task[None] | None = None
        self.newest: Reference | None = None

    def follow(self, state: State) -> None:
        """Have the reference of ``state``, if it is wanted, and stop tracing any other; again where that failed."""
        key = content_key(state.reference_key) if state.split == REFERENCE else ""
        same = key == self._key
        if same and not self._failed:
            return
        self.stop()
        self._key, self._failed = key, False
        if self.newest is not None and not same:
            self.newest = None
            self._tell(None)
        if key:
            self._work = asyncio.create_task(self._refine(key, replace(state, bookmarks=())))

    def stop(self) -> None:
        """Trace no further."""
        self._key = ""
        if self._work is not None:
            self._work.cancel()
            self._work = None

    async def _refine(self, key: str, state: State) -> None:
        done, folder = self._kept.get(key, (0, Path()))
        try:
            if done:
                await self._show(folder)
            await asyncio.sleep(REST_SECONDS)
            for number in range(done, len(SAMPLES)):
                finer = self._new_folder()
                try:
                    await self._trace(state, number, finer)
                    if number:
                        await asyncio.to_thread(_add, finer, folder)
                except BaseException:
                    _delete(finer)
                    raise
                folder = finer
                self._keep(key, number + 1, folder)
                await self._show(folder)
        except Exception as error:  # of the disk, too: the pages are told instead of waiting for ever
            self._failed = True
            self._on_error(error)

    def _new_folder(self) -> Path:
        """One that no other attempt has: the thread of one that was stopped writes on in its own for a while."""
        self._folder.mkdir(parents=True, exist_ok=True)
        return Path(mkdtemp(dir=self._folder))

    async def _trace(self, state: State, number: int, folder: Path) -> None:
        """Trace the samples of one refinement, which are like those of no other, into ``folder``."""
        exporter_version(self._parts.scene)  # says what is missing, if anything is
        file = folder / "scene.json"
        write_scene_json(file, state, self._parts)
        await run_module("export", ["reference", str(self._file), "--scene-json", str(file), "--camera", NAME,
                                    "--lighting", NAME, "--size", f"{state.size[0]}x{state.size[1]}",
                                    "--spp", str(SAMPLES[number]), "--seed", str(number), "--out", str(folder)],
                         nice=True)

    def _keep(self, key: str, number: int, folder: Path) -> None:
        """Have the reference in ``folder`` in place of a coarser one, and none of the oldest beyond ``MAX_KEPT``."""
        dropped = [self._kept.pop(key)] if key in self._kept else []
        self._kept[key] = number, folder
        if len(self._kept) > MAX_KEPT:
            dropped.append(self._kept.pop(next(iter(self._kept))))
        for _, old in dropped:
            _delete(old)

    async def _show(self, folder: Path) -> None:
        self.newest = await asyncio.to_thread(read_reference, folder)
        self._tell(self.newest)


def _add(folder: Path, other: Path) -> None:
    """Make the reference in ``folder`` the mean over its own samples and those of ``other``."""
    references = read_reference(folder), read_reference(other)
    counts = [reference.about["spp"] for reference in references]
    layers = {name: np.average([reference.layers[name] for reference in references], axis=0, weights=counts).astype(np.float32)
              for name in references[0].layers}
    write_exr(folder / "reference.exr", {"" if name == FINAL else name: layer for name, layer in layers.items()})
    known = {name: value for name, value in references[0].about.items() if name not in ("noise", "seed", "seconds")}
    write_text(folder / "reference.json", json.dumps({**known, "spp": sum(counts)}))


def _delete(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
