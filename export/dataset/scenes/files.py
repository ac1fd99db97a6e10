"""Scene files as a source: their surfaces in other colours, under other lights, from other places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.errors import SceneError
from app.load import load_scene
from app.load.sidecar import read_sidecar
from app.load.survey import Survey
from app.scene import Light, Material, Scene
from export.dataset.held_out import refuse_held_out
from export.dataset.scenes import lights
from export.dataset.scenes.generated_scene import GeneratedScene, Rng
from export.dataset.scenes.materials import BRIGHTEST, color

F64 = NDArray[np.float64]

OWN_LIGHTING = 0.35  # how often the file's lights stay
OWN_COLORS = 0.25    # how often all its colours do
REPAINTED = 0.4      # share of the untextured materials that get another colour otherwise
HEIGHTS = (0.12, 0.75)  # of eyes between floor and ceiling


def open_file(rng: Rng, files: Sequence[str]) -> GeneratedScene:
    """One of ``files``, changed at random.

    Raises
    ------
    SceneError
        When the file can't be read.
    SettingsError
        When it belongs to the validation list.
    """
    file = Path(files[int(rng.integers(len(files)))])
    refuse_held_out(file)
    lightings = _lightings(file)
    scene = _load(file, lightings[rng.integers(len(lightings))] if lightings else None)
    free, points = standing(file)
    if rng.random() >= OWN_LIGHTING:
        scene = _relit(rng, scene, points)
    if rng.random() >= OWN_COLORS:
        scene = replace(scene, materials=tuple(_repainted(rng, m) for m in scene.materials))
    return GeneratedScene(scene, free, np.zeros((0, 2, 3)))


@lru_cache(maxsize=4)
def _load(file: Path, lighting: str | None) -> Scene:
    return load_scene(file, lighting=lighting)


def _lightings(file: Path) -> list[str]:
    beside = file.with_suffix(".json")
    return list(read_sidecar(beside).lightings) if beside.is_file() else []


@lru_cache(maxsize=4)
def standing(file: Path) -> tuple[F64, F64]:
    """Boxes that eyes may be in, shape (K, 2, 3), and points in the open for lamps, shape (M, 3)."""
    scene = _load(file, None)
    survey = Survey(scene.meshes, scene.instances)
    points = survey.room_points
    if not len(points):
        raise SceneError("no place to stand in", file, "expected a scene that is seen from the inside")
    up, down = (survey.cast(points, np.tile([0.0, sign, 0.0], (len(points), 1)))[0] for sign in (1.0, -1.0))
    up, below = np.minimum(up, scene.longest_edge), np.minimum(down, scene.longest_edge)
    height = below / (up + below)
    reach = np.minimum(survey.around(points)[0].min(axis=1), 0.1 * scene.longest_edge) / 2
    stands = np.isfinite(down) & (height > HEIGHTS[0]) & (height < HEIGHTS[1])
    half = reach[stands, None, None] * np.array([[-1.0], [1.0]])
    return points[stands, None] + half, points


def _relit(rng: Rng, scene: Scene, points: F64) -> Scene:
    """Lamps at random places, and now and then the sun, instead of all lights; what glowed goes dark."""
    watts = (0.25 * scene.longest_edge) ** 2 * 0.5
    found: list[Light] = [lights.lamp(rng, points[rng.integers(len(points))], watts) for _ in range(rng.integers(1, 4))]
    if rng.random() < 0.25:
        found.append(lights.sun(rng))
    dark = tuple(replace(m, emission=(0.0, 0.0, 0.0)) for m in scene.materials)
    return replace(scene, materials=dark, lights=tuple(found))


def _repainted(rng: Rng, material: Material) -> Material:
    if material.albedo_map is None and rng.random() < REPAINTED:
        return replace(material, albedo=color(rng, 0.1, BRIGHTEST))
    tint = np.asarray(color(rng, 0.7, 1.3))
    r, g, b = np.minimum(np.asarray(material.albedo) * tint, BRIGHTEST).tolist()
    return replace(material, albedo=(r, g, b))


