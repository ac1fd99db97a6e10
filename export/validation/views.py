"""The validation views, listed in ``views.json``, which ``python -m export validate choose`` writes.

They were chosen once: most before the first training run, those of ``EMISSIVE_SOURCES`` and of the bathroom later. The
dataset refuses their scene files, except for those that the list marks as not held out, and their procedural scenes
come from seeds or generators that it never uses.
"""

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from app.errors import SceneError
from app.load import load_scene
from app.scene import Camera, Scene
from export.dataset.held_out import LIST, read_list
from export.dataset.scene_key import scene_key
from export.dataset.scenes.found_emitters import with_found_emitters
from export.dataset.scenes.generated_scene import GeneratedScene
from export.dataset.scenes.sources import SOURCES
from export.reference.still import Still
from export.validation.scenes.sources import EMISSIVE_SOURCES

VALIDATION = 1  # first number of every seed; see ``export.dataset.plan``


@dataclass(frozen=True, eq=False)
class View:
    """One validation picture; ``scene`` names its scene regardless of the lighting."""

    name: str
    scene: str
    still: Still


def views(scenes: Path, only: Collection[str] = (), lightings: Collection[str] = (),
          names: Collection[str] = ()) -> list[View]:
    """All views; those of one scene and lighting are consecutive and share one ``Scene`` object.

    Parameters
    ----------
    scenes : Path
        Folder of the scene files.
    only : collection of str
        Names of scenes; all scenes if empty.
    lightings : collection of str
        Names of lightings; all if empty.
    names : collection of str
        Names of views; all if empty.

    Raises
    ------
    SceneError
        When a scene file is missing or differs from the listed one, or a generator has changed.
    """
    listed = read_list()
    loaded: dict[str, Scene] = {}
    chosen = []
    for entry in listed["views"]:
        if (only and entry["scene"] not in only) or (lightings and entry.get("lighting") not in lightings) or (
                names and entry["name"] not in names):
            continue
        group = json.dumps([entry.get(key) for key in ("scene", "lighting", "seed")])
        if group not in loaded:
            loaded[group] = _scene(entry, listed["files"], scenes)
        values: dict[str, Any] = {key: tuple(x) if isinstance(x, list) else x for key, x in entry["camera"].items()}
        still = Still(loaded[group], Camera(**values), tuple(entry.get("size", listed["size"])))
        chosen.append(View(entry["name"], entry["scene"], still))
    return chosen


def generated(source: str, seed: int, arguments: Mapping[str, Any] | None = None) -> GeneratedScene:
    """A procedural scene that the dataset never makes; ``arguments`` are the generator's own."""
    return {**SOURCES, **EMISSIVE_SOURCES}[source](np.random.default_rng([VALIDATION, seed]), **(arguments or {}))


def _scene(entry: dict[str, Any], files: dict[str, Any], folder: Path) -> Scene:
    if "seed" not in entry:
        return load_scene(folder / files[entry["scene"]]["file"], lighting=entry["lighting"])
    scene = generated(entry["source"], entry["seed"], entry.get("arguments")).scene
    if scene_key(scene) != entry["key"]:
        raise SceneError(f"the generator of {entry['source']!r} has changed since the list was written", LIST,
                         "expected the same scene; write a new list with: python -m export validate choose")
    return with_found_emitters(scene) if entry["source"] in EMISSIVE_SOURCES else scene
