"""Rooms in a row behind openings, few of them lit: from the others, light is behind the camera or around a corner."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from export.dataset.scenes import lights
from export.dataset.scenes.assembly import Assembly
from export.dataset.scenes.furniture import random_furniture
from export.dataset.scenes.generated_scene import GeneratedScene, Rng
from export.dataset.scenes.indoors import furnish, hang_lamps
from export.dataset.scenes.materials import ceiling, floor, thing, wall
from export.dataset.scenes.parts import slab
from export.dataset.scenes.walls import THICKNESS, Opening, Wall, build, rectangle, with_openings

SUNNY = 0.45      # share of the connected_rooms that the sun lights through an end wall
SHUTTERED = 0.5   # share of those windows and doors that a shutter covers from above
SPOTS = 0.6       # share of the others' lit rooms that spots light, others have lamps of any kind
SECOND_LIT = 0.2  # share of the further rooms that are lit, too
SLAT = 0.03       # thickness of a shutter, metres


def connected_rooms(rng: Rng) -> GeneratedScene:
    """Two or three rooms of 2.5 to 6 metres along their sides."""
    assembly = Assembly(rng)
    width, height = float(rng.uniform(2.5, 6.0)), float(rng.uniform(2.3, 3.2))
    depths = rng.uniform(2.5, 6.0, rng.integers(2, 4))
    depth = float(depths.sum())
    edges = (np.concatenate([[0.0], np.cumsum(depths)]) - depth / 2).tolist()
    outside = rectangle(width, depth, height)
    if sunny := bool(rng.random() < SUNNY):
        outside[0] = with_openings(rng, outside[0], int(rng.integers(1, 3)))
        sunny = bool(outside[0].openings)
    between = [_parting(rng, width, z, height) for z in edges[1:-1]]
    walls = [*outside, *between]
    build(assembly, walls, [wall(rng) for _ in walls] if rng.random() < 0.6 else [wall(rng)] * len(walls))
    x, z, t = width / 2 + THICKNESS, depth / 2 + THICKNESS, THICKNESS
    assembly.add(slab((-x, -t, -z), (x, 0, z)), floor(rng))
    assembly.add(slab((-x, height, -z), (x, height + t, z)), ceiling(rng))

    for o in outside[0].openings:
        if rng.random() < SHUTTERED:
            _shutter(rng, assembly, outside[0], o)

    free = []
    first = 0 if sunny else int(rng.integers(len(depths)))
    for number, (near, end) in enumerate(pairwise(edges)):
        far = end if number == len(depths) - 1 else end - THICKNESS
        furnish(rng, assembly, width, far - near, random_furniture, rng.uniform(0.05, 0.4), (0.0, (near + far) / 2))
        free.append([[-width / 2 + 0.25, 0.5, near + 0.25], [width / 2 - 0.25, min(2.1, height - 0.2), far - 0.1]])
        if number == first and sunny:
            azimuth = math.atan2(outside[0].inward[0], -outside[0].inward[2]) + rng.uniform(-0.7, 0.7)
            assembly.lights.append(lights.sun(rng, azimuth, irradiance=25.0))
        elif number == first or rng.random() < SECOND_LIT:
            _light(rng, assembly, np.array([[-width / 2, 0, near], [width / 2, height, far]]))
    return assembly.place("connected_rooms", free)


def _shutter(rng: Rng, assembly: Assembly, outside: Wall, o: Opening) -> None:
    """What leaves 2 to 100 % of an opening open at its bottom, more often little: at times the sill alone is lit.

    The wall ``outside`` is that at -z.
    """
    bottom = o.bottom + (o.top - o.bottom) * float(rng.uniform(0.15, 1.0) ** 2)
    left, back = outside.point(o.left, bottom, THICKNESS)[[0, 2]].tolist()
    right = float(outside.point(o.right, bottom)[0])
    assembly.add(slab((left, bottom, back), (right, o.top, back + SLAT)), thing(rng))


def _parting(rng: Rng, width: float, z: float, height: float) -> Wall:
    """A wall across, with a door or a wide opening."""
    wide = float(rng.uniform(0.8, 1.2) if rng.random() < 0.4 else rng.uniform(1.2, width - 0.4))
    left = float(rng.uniform(0.2, width - wide - 0.2))
    top = float(rng.uniform(2.0, height - 0.1))
    return Wall(np.array([-width / 2, z]), np.array([width / 2, z]), height, (Opening(left, left + wide, 0.0, top),))


def _light(rng: Rng, assembly: Assembly, box: NDArray[np.float64]) -> None:
    """A few lamps in a room, or spots on its walls and things."""
    count = int(rng.integers(1, 4))
    if rng.random() >= SPOTS:
        hang_lamps(rng, assembly, box, count)
        return
    for _ in range(count):
        at = rng.uniform(box[0] + 0.3, box[1] - 0.3)
        at[1] = box[1, 1] - rng.uniform(0.1, 0.5)
        turn, down = rng.uniform(0, 2 * math.pi), rng.uniform(0.1, 1.5)
        assembly.lights.append(lights.spot(rng, at, np.array([math.cos(turn), -down, math.sin(turn)]), watts=4.0))
