"""Corridors with bends, doors, niches and side rooms."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from app.scene import Material
from export.dataset.scenes import lights
from export.dataset.scenes.assembly import Assembly
from export.dataset.scenes.furniture import random_furniture
from export.dataset.scenes.generated_scene import GeneratedScene, Rng
from export.dataset.scenes.indoors import furnish, hang_lamps
from export.dataset.scenes.materials import ceiling, floor, wall
from export.dataset.scenes.parts import quad, slab

Cells = NDArray[np.bool_]

GRID = 9          # cells along a side, of which a winding way is hollowed out
DOORS = 0.2       # share of the ways between cells that are narrowed to a door
STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0))


def corridor(rng: Rng) -> GeneratedScene:
    """A way of square cells through solid ground, with niches; every cell is as wide as the corridor."""
    assembly = Assembly(rng)
    cells, way = _hollow(rng)
    side, height = float(rng.uniform(1.3, 2.6)), float(rng.uniform(2.2, 3.5))
    paint = [wall(rng) for _ in range(rng.integers(1, 4))]
    ground, top = floor(rng), ceiling(rng)
    free = []
    for i, j in np.argwhere(cells).tolist():
        x, z = i * side, j * side
        assembly.add(slab((x, -0.1, z), (x + side, 0, z + side)), ground)
        assembly.add(slab((x, height, z), (x + side, height + 0.1, z + side)), top)
        free.append([[x + 0.3, 0.6, z + 0.3], [x + side - 0.3, min(2.0, height - 0.2), z + side - 0.3]])
        for di, dj in STEPS:
            if not cells[i + di, j + dj]:
                _wall(assembly, x, z, side, height, di, dj, paint[(i + j) // 3 % len(paint)])
    for (i, j), (k, m) in pairwise(way):
        if rng.random() < DOORS:
            _door(assembly, max(i, k) * side, max(j, m) * side, side, height, k != i, paint[0])
    for i, j in way:
        box = np.array([[i * side, 0, j * side], [(i + 1) * side, height, (j + 1) * side]])
        if rng.random() < 0.25:
            furnish(rng, assembly, side, side, random_furniture, 0.1, (box[:, 0].mean(), box[:, 2].mean()))
        if rng.random() < 0.3:
            hang_lamps(rng, assembly, box, 1)
    if not assembly.lights:
        i, j = way[rng.integers(len(way))]
        at = np.array([(i + 0.5) * side, 0.9 * height, (j + 0.5) * side])
        assembly.lights.append(lights.lamp(rng, at, 2.0))
    return assembly.place("corridor", free)


def _hollow(rng: Rng) -> tuple[Cells, list[tuple[int, int]]]:
    """Cells that are hollow, with a solid border, and the winding way among them."""
    cells = np.zeros((GRID + 2, GRID + 2), bool)
    at = (int(rng.integers(1, GRID + 1)), int(rng.integers(1, GRID + 1)))
    way, heading = [at], int(rng.integers(4))
    cells[at] = True
    for _ in range(200):
        if len(way) >= 14:
            break
        if rng.random() < 0.3:
            heading = int(rng.integers(4))
        di, dj = STEPS[heading]
        onward = (at[0] + di, at[1] + dj)
        if not (1 <= onward[0] <= GRID and 1 <= onward[1] <= GRID):
            heading = int(rng.integers(4))
            continue
        at = onward
        way.append(at)
        cells[at] = True
    for i, j in way:
        di, dj = STEPS[rng.integers(4)]
        if rng.random() < 0.2 and 1 <= i + di <= GRID and 1 <= j + dj <= GRID:
            cells[i + di, j + dj] = True
    return cells, way


def _wall(assembly: Assembly, x: float, z: float, side: float, height: float, di: int, dj: int,
          paint: Material) -> None:
    """The wall of a cell towards its solid neighbour."""
    along = (-dj * side, 0.0, di * side)
    corner = (x + (side + di * side - along[0]) / 2, 0.0, z + (side + dj * side - along[2]) / 2)
    assembly.add(quad(corner, along, (0.0, height, 0.0)), paint)


def _door(assembly: Assembly, x: float, z: float, side: float, height: float, across_x: bool,
          paint: Material) -> None:
    """A frame between two cells that meet at x (or z)."""
    post, head = 0.2 * side, min(2.1, height - 0.1)
    for low, high, bottom in ((0.0, post, 0.0), (side - post, side, 0.0), (post, side - post, head)):
        if across_x:
            part = slab((x - 0.06, bottom, z + low), (x + 0.06, height, z + high))
        else:
            part = slab((x + low, bottom, z - 0.06), (x + high, height, z + 0.06))
        assembly.add(part, paint)
