"""The path-traced reference of the current view, refined while nothing changes and cached per view."""

import asyncio
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from app.evaluation.hashing import content_key
from app.evaluation.reference import Reference, read_reference
from app.evaluation.versions import exporter_version
from app.io.atomic_files import write_text
from app.io.child_process import run_module_async
from app.io.image import write_exr
from app.load import LoadedScene
from app.paths import TRAINING
from app.view.scene_file import VIEW_NAME, content_arguments, write_scene_json
from app.view.state import FINAL, REFERENCE, State

SAMPLES = (8, 24, 96, 384)  # per pixel, added by each refinement
START_DELAY_SECONDS = 0.7   # without changes before tracing starts or resumes
MAX_CACHED = 64


class ReferenceTracer:
    """Traces the reference of the latest state.

    Parameters
    ----------
    on_reference : callable
        Receives each refinement of the reference, and None when the current view has no reference.
    on_error : callable
        Receives an exception.

    Attributes
    ----------
    latest : Reference or None
        The reference of the current view.
    """

    def __init__(self, file: Path, loaded: LoadedScene, folder: Path,
                 on_reference: Callable[[Reference | None], object], on_error: Callable[[Exception], object]) -> None:
        self._file, self._loaded, self._folder = file, loaded, folder
        self._on_reference, self._on_error = on_reference, on_error
        self._cache: dict[str, tuple[int, Path]] = {}  # number of refinements, and folder
        self._key, self._failed = "", False
        self._work: asyncio.Task[None] | None = None
        self.latest: Reference | None = None

    def follow(self, state: State) -> None:
        """Trace the reference of ``state`` if it is shown, and stop tracing any other; retry after a failure."""
        key = content_key(state.reference_key) if state.split == REFERENCE else ""
        same = key == self._key
        if same and not self._failed:
            return
        self.stop()
        self._key, self._failed = key, False
        if self.latest is not None and not same:
            self.latest = None
            self._on_reference(None)
        if key:
            self._work = asyncio.create_task(self._refine(key, replace(state, bookmarks=())))

    def stop(self) -> None:
        """Stop tracing."""
        self._key = ""
        if self._work is not None:
            self._work.cancel()
            self._work = None

    async def _refine(self, key: str, state: State) -> None:
        refinements, folder = self._cache.get(key, (0, Path()))
        try:
            if refinements:
                await self._show(folder)
            await asyncio.sleep(START_DELAY_SECONDS)
            for index in range(refinements, len(SAMPLES)):
                finer = self._new_folder()
                try:
                    await self._trace(state, index, finer)
                    if index:
                        await asyncio.to_thread(_accumulate, finer, folder)
                except BaseException:
                    _delete(finer)
                    raise
                folder = finer
                self._store(key, index + 1, folder)
                await self._show(folder)
        except Exception as error:  # any error, those of the disk included: pages must not wait for ever
            self._failed = True
            self._on_error(error)

    def _new_folder(self) -> Path:
        """Create a folder for one attempt: the thread of a cancelled attempt may still write to its own."""
        self._folder.mkdir(parents=True, exist_ok=True)
        return Path(mkdtemp(dir=self._folder))

    async def _trace(self, state: State, index: int, folder: Path) -> None:
        """Trace the samples of one refinement into ``folder``, with a seed of their own."""
        exporter_version(self._loaded.scene)  # raises if an optional package is missing
        file = folder / "scene.json"
        write_scene_json(file, state, self._loaded)
        await run_module_async(TRAINING, [
            "reference", str(self._file), "--scene-json", str(file), "--camera", VIEW_NAME, "--lighting", VIEW_NAME,
            "--size", f"{state.size[0]}x{state.size[1]}", "--spp", str(SAMPLES[index]), "--seed", str(index),
            "--out", str(folder),
            *content_arguments(state, self._loaded.animation, self._loaded.variant)], nice=True)

    def _store(self, key: str, refinements: int, folder: Path) -> None:
        """Cache the reference in ``folder`` in place of a coarser one; evict the oldest beyond ``MAX_CACHED``."""
        evicted = [self._cache.pop(key)] if key in self._cache else []
        self._cache[key] = refinements, folder
        if len(self._cache) > MAX_CACHED:
            evicted.append(self._cache.pop(next(iter(self._cache))))
        for _, old in evicted:
            _delete(old)

    async def _show(self, folder: Path) -> None:
        self.latest = await asyncio.to_thread(read_reference, folder)
        self._on_reference(self.latest)


def _accumulate(folder: Path, other: Path) -> None:
    """Replace the reference in ``folder`` by the mean over its own samples and those in ``other``."""
    references = read_reference(folder), read_reference(other)
    counts = [reference.about["spp"] for reference in references]
    layers = {"" if name == FINAL else name: np.average([r.layers[name] for r in references], axis=0, weights=counts)
              for name in references[0].layers}
    write_exr(folder / "reference.exr", {name: layer.astype(np.float32) for name, layer in layers.items()})
    about = {name: value for name, value in references[0].about.items() if name not in ("noise", "seed", "seconds")}
    write_text(folder / "reference.json", json.dumps({**about, "spp": sum(counts)}))


def _delete(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
