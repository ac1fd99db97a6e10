"""The views that networks are judged by: ``validation.json``, written by ``scripts/make_validation.py``.

They were chosen once, before the first training run. Their scene files are refused by the dataset, and their procedural
scenes come from seeds that it never uses.
"""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from app.errors import SceneError
from app.load import load_scene
from app.scene import Camera, Scene
from export.dataset.held_out import LIST, read_list
from export.dataset.key import scene_key
from export.dataset.scenes.generated_scene import GeneratedScene
from export.dataset.scenes.sources import SOURCES
from export.reference.still import Still

SCENES = Path("../shared/scenes")
VALIDATION = 1  # first number of every seed; see ``export.dataset.plan``


@dataclass(frozen=True, eq=False)
class View:
    """One picture to judge by; ``scene`` is the name of its scene, whatever the lighting."""

    name: str
    scene: str
    still: Still


def views(scenes: Path = SCENES, only: Collection[str] = ()) -> list[View]:
    """All views, those of one scene and lighting together, which share one ``Scene`` object.

    Parameters
    ----------
    scenes : Path
        The folder that the scene files of the list lie in.
    only : collection of str
        Names of the scenes that are wanted; all without any.

    Raises
    ------
    SceneError
        When a scene file is missing or is not the one that the list was made for, or a generator has changed.
    """
    listed = read_list()
    loaded: dict[str, Scene] = {}
    found = []
    for entry in listed["views"]:
        if only and entry["scene"] not in only:
            continue
        group = json.dumps([entry.get(key) for key in ("scene", "lighting", "seed")])
        if group not in loaded:
            loaded[group] = _scene(entry, listed["files"], scenes)
        values: dict[str, Any] = {key: tuple(x) if isinstance(x, list) else x for key, x in entry["camera"].items()}
        still = Still(loaded[group], Camera(**values), tuple(listed["size"]))
        found.append(View(entry["name"], entry["scene"], still))
    return found


def generated(source: str, seed: int) -> GeneratedScene:
    """A procedural scene that the dataset never makes."""
    return SOURCES[source](np.random.default_rng([VALIDATION, seed]))


def _scene(entry: dict[str, Any], files: dict[str, Any], folder: Path) -> Scene:
    if "seed" not in entry:
        return load_scene(folder / files[entry["scene"]]["file"], lighting=entry["lighting"])
    scene = generated(entry["source"], entry["seed"]).scene
    if scene_key(scene) != entry["key"]:
        raise SceneError(f"the generator of {entry['source']!r} has changed since the list was made", LIST,
                         "expected the same scene; make the list again: python -m export validate choose")
    return scene
