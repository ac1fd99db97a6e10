"""Corridors with bends, doors and niches."""

from itertools import pairwise

import numpy as np

from app.arrays import Bools
from app.scene import Material
from export.dataset.scenes import lights
from export.dataset.scenes.furniture import random_furniture
from export.dataset.scenes.generated_scene import GeneratedScene, GeneratedSceneBuilder, Rng
from export.dataset.scenes.indoors import add_local_lights, furnish
from export.dataset.scenes.materials import ceiling_material, floor_material, wall_material
from export.dataset.scenes.parts import quad, slab

GRID = 9                # cells along each side
PATH_CELLS = 14
MAX_PATH_STEPS = 200
DOOR_PROBABILITY = 0.2  # between two cells of the path
STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0))


def corridor(rng: Rng) -> GeneratedScene:
    """A winding path of square cells as wide as the corridor, with niches."""
    builder = GeneratedSceneBuilder(rng)
    cells, path = _carve(rng)
    side, height = float(rng.uniform(1.3, 2.6)), float(rng.uniform(2.2, 3.5))
    wall_materials = [wall_material(rng) for _ in range(rng.integers(1, 4))]
    ground, top = floor_material(rng), ceiling_material(rng)
    camera_volumes = []
    for i, j in np.argwhere(cells).tolist():
        x, z = i * side, j * side
        builder.add(slab((x, -0.1, z), (x + side, 0, z + side)), ground)
        builder.add(slab((x, height, z), (x + side, height + 0.1, z + side)), top)
        camera_volumes.append([[x + 0.3, 0.6, z + 0.3], [x + side - 0.3, min(2.0, height - 0.2), z + side - 0.3]])
        for di, dj in STEPS:
            if not cells[i + di, j + dj]:  # a wall to the solid neighbour
                along = (-dj * side, 0.0, di * side)
                corner = (x + (side + di * side - along[0]) / 2, 0.0, z + (side + dj * side - along[2]) / 2)
                material = wall_materials[(i + j) // 3 % len(wall_materials)]
                builder.add(quad(corner, along, (0.0, height, 0.0)), material)
    for (i, j), (k, m) in pairwise(path):
        if rng.random() < DOOR_PROBABILITY:
            _add_door(builder, max(i, k) * side, max(j, m) * side, side, height, k != i, wall_materials[0])
    for i, j in path:
        box = np.array([[i * side, 0, j * side], [(i + 1) * side, height, (j + 1) * side]])
        if rng.random() < 0.25:
            furnish(rng, builder, side, side, random_furniture, 0.1, (box[:, 0].mean(), box[:, 2].mean()))
        if rng.random() < 0.3:
            add_local_lights(rng, builder, box, 1)
    if not builder.lights:
        i, j = path[rng.integers(len(path))]
        at = np.array([(i + 0.5) * side, 0.9 * height, (j + 0.5) * side])
        builder.lights.append(lights.local_light(rng, at, 2.0))
    return builder.build("corridor", camera_volumes)


def _carve(rng: Rng) -> tuple[Bools, list[tuple[int, int]]]:
    """Which cells are hollow, with a solid border, and the winding path among them."""
    cells = np.zeros((GRID + 2, GRID + 2), bool)
    at = (int(rng.integers(1, GRID + 1)), int(rng.integers(1, GRID + 1)))
    path, heading = [at], int(rng.integers(4))
    cells[at] = True
    for _ in range(MAX_PATH_STEPS):
        if len(path) >= PATH_CELLS:
            break
        if rng.random() < 0.3:
            heading = int(rng.integers(4))
        di, dj = STEPS[heading]
        onward = (at[0] + di, at[1] + dj)
        if not (1 <= onward[0] <= GRID and 1 <= onward[1] <= GRID):
            heading = int(rng.integers(4))
            continue
        at = onward
        path.append(at)
        cells[at] = True
    for i, j in path:
        di, dj = STEPS[rng.integers(4)]
        if rng.random() < 0.2 and 1 <= i + di <= GRID and 1 <= j + dj <= GRID:
            cells[i + di, j + dj] = True
    return cells, path


def _add_door(builder: GeneratedSceneBuilder, x: float, z: float, side: float, height: float, across_x: bool,
          material: Material) -> None:
    """Add a door frame between two cells that meet at x (or z)."""
    post, head = 0.2 * side, min(2.1, height - 0.1)
    for low, high, bottom in ((0.0, post, 0.0), (side - post, side, 0.0), (post, side - post, head)):
        if across_x:
            part = slab((x - 0.06, bottom, z + low), (x + 0.06, height, z + high))
        else:
            part = slab((x + low, bottom, z - 0.06), (x + high, height, z + 0.06))
        builder.add(part, material)
