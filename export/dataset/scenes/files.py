"""Scene files as a source, with random albedos and lights."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from app.arrays import F64
from app.errors import SceneError
from app.load import load_scene
from app.load.free_space import FreeSpace
from app.load.sidecar import read_sidecar
from app.scene import Light, Material, Scene
from export.dataset.held_out import refuse_held_out
from export.dataset.scenes import lights
from export.dataset.scenes.generated_scene import GeneratedScene, Rng
from export.dataset.scenes.materials import MAX_ALBEDO, random_color

OWN_LIGHTING_PROBABILITY = 0.35
OWN_ALBEDO_PROBABILITY = 0.25
NEW_ALBEDO_SHARE = 0.4         # of the untextured materials; the others are tinted
EYE_HEIGHTS = (0.12, 0.75)     # between floor (0) and ceiling (1)

_load = lru_cache(maxsize=4)(load_scene)


def load_random_file(rng: Rng, files: Sequence[Path]) -> GeneratedScene:
    """One of ``files``, with random changes.

    Raises
    ------
    SceneError
        When the file can't be read.
    SettingsError
        When it belongs to the validation list.
    """
    file = files[int(rng.integers(len(files)))]
    refuse_held_out(file)
    sidecar = file.with_suffix(".json")
    lightings = list(read_sidecar(sidecar).lightings) if sidecar.is_file() else []
    scene = _load(file, lighting=lightings[rng.integers(len(lightings))] if lightings else None)
    camera_volumes, points = find_camera_volumes(file)
    if rng.random() >= OWN_LIGHTING_PROBABILITY:
        scene = _with_random_lights(rng, scene, points)
    if rng.random() >= OWN_ALBEDO_PROBABILITY:
        scene = replace(scene, materials=tuple(_with_random_albedo(rng, m) for m in scene.materials))
    return GeneratedScene(scene, camera_volumes, np.zeros((0, 2, 3)))


@lru_cache(maxsize=4)
def find_camera_volumes(file: Path) -> tuple[F64, F64]:
    """Boxes for cameras, shape (K, 2, 3), and points in free space for lights, shape (M, 3).

    Raises
    ------
    SceneError
        When the file can't be read, or the scene has no interior.
    """
    scene = _load(file, lighting=None)
    space = FreeSpace(scene.meshes, scene.instances)
    points = space.room_points
    if not len(points):
        raise SceneError("no free space for cameras", file, "expected a scene with an interior")
    up, down = (space.cast(points, np.tile([0.0, sign, 0.0], (len(points), 1)))[0] for sign in (1.0, -1.0))
    up, below = np.minimum(up, scene.longest_edge), np.minimum(down, scene.longest_edge)
    height = below / (up + below)
    reach = np.minimum(space.around(points)[0].min(axis=1), 0.1 * scene.longest_edge) / 2
    suitable = np.isfinite(down) & (height > EYE_HEIGHTS[0]) & (height < EYE_HEIGHTS[1])
    half_size = reach[suitable, None, None] * np.array([[-1.0], [1.0]])
    return points[suitable, None] + half_size, points


def _with_random_lights(rng: Rng, scene: Scene, points: F64) -> Scene:
    """The scene with lights at random points, and sometimes the sun, in place of its lights and emission."""
    intensity = (0.25 * scene.longest_edge) ** 2 * 0.5
    random_lights: list[Light] = [lights.local_light(rng, points[rng.integers(len(points))], intensity)
                                  for _ in range(rng.integers(1, 4))]
    if rng.random() < 0.25:
        random_lights.append(lights.sun(rng))
    dark = tuple(replace(m, emission=(0.0, 0.0, 0.0)) for m in scene.materials)
    return replace(scene, materials=dark, lights=tuple(random_lights))


def _with_random_albedo(rng: Rng, material: Material) -> Material:
    if material.albedo_map is None and rng.random() < NEW_ALBEDO_SHARE:
        return replace(material, albedo=random_color(rng, 0.1, MAX_ALBEDO))
    tint = np.asarray(random_color(rng, 0.7, 1.3))
    r, g, b = np.minimum(np.asarray(material.albedo) * tint, MAX_ALBEDO).tolist()
    return replace(material, albedo=(r, g, b))
