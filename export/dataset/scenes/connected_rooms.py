"""Rooms in a row, few of them lit: in the others, light comes from behind the camera or around a corner."""

import math
from itertools import pairwise

import numpy as np

from app.arrays import F64
from export.dataset.scenes import lights
from export.dataset.scenes.furniture import random_furniture
from export.dataset.scenes.generated_scene import GeneratedScene, GeneratedSceneBuilder, Rng
from export.dataset.scenes.indoors import add_local_lights, furnish
from export.dataset.scenes.materials import ceiling_material, floor_material, furniture_material, wall_material
from export.dataset.scenes.parts import slab
from export.dataset.scenes.walls import (
    THICKNESS,
    Opening,
    Wall,
    add_ceiling,
    add_floor,
    add_walls,
    rectangle,
    with_openings,
)

SUN_PROBABILITY = 0.45          # of sunlight through an end wall
SHUTTER_PROBABILITY = 0.5       # that a shutter covers the upper part of a window or door of that wall
SPOT_PROBABILITY = 0.6          # that a lit room has spot lights rather than lights of any kind
SECOND_LIGHT_PROBABILITY = 0.2  # that a further room is lit
SHUTTER_THICKNESS = 0.03        # metres


def connected_rooms(rng: Rng) -> GeneratedScene:
    """Two or three rooms of 2.5 to 6 metres along their sides."""
    builder = GeneratedSceneBuilder(rng)
    width, height = float(rng.uniform(2.5, 6.0)), float(rng.uniform(2.3, 3.2))
    depths = rng.uniform(2.5, 6.0, rng.integers(2, 4))
    depth = float(depths.sum())
    edges = (np.concatenate([[0.0], np.cumsum(depths)]) - depth / 2).tolist()
    outside = rectangle(width, depth, height)
    if sunny := bool(rng.random() < SUN_PROBABILITY):
        outside[0] = with_openings(rng, outside[0], int(rng.integers(1, 3)))
        sunny = bool(outside[0].openings)
    walls = [*outside, *(_partition(rng, width, z, height) for z in edges[1:-1])]
    several = rng.random() < 0.6
    add_walls(builder, walls, [wall_material(rng) for _ in walls] if several else [wall_material(rng)] * len(walls))
    add_floor(builder, width, depth, floor_material(rng))
    add_ceiling(builder, width, depth, height, ceiling_material(rng))

    for o in outside[0].openings:
        if rng.random() < SHUTTER_PROBABILITY:
            _add_shutter(rng, builder, outside[0], o)

    camera_volumes = []
    first = 0 if sunny else int(rng.integers(len(depths)))
    for number, (near, end) in enumerate(pairwise(edges)):
        far = end if number == len(depths) - 1 else end - THICKNESS
        furnish(rng, builder, width, far - near, random_furniture, rng.uniform(0.05, 0.4), (0.0, (near + far) / 2))
        x = width / 2 - 0.25
        camera_volumes.append([[-x, 0.5, near + 0.25], [x, min(2.1, height - 0.2), far - 0.1]])
        if number == first and sunny:
            azimuth = outside[0].inward_azimuth + rng.uniform(-0.7, 0.7)
            builder.lights.append(lights.sun(rng, azimuth, irradiance=25.0))
        elif number == first or rng.random() < SECOND_LIGHT_PROBABILITY:
            _add_lights(rng, builder, np.array([[-width / 2, 0, near], [width / 2, height, far]]))
    return builder.build("connected_rooms", camera_volumes)


def _add_shutter(rng: Rng, builder: GeneratedSceneBuilder, outside: Wall, o: Opening) -> None:
    """Cover the upper part of an opening in the wall ``outside``, the one at -z.

    2 to 100 % of the opening stay open at its bottom, more often little, so that sometimes only the sill is lit.
    """
    bottom = o.bottom + (o.top - o.bottom) * float(rng.uniform(0.15, 1.0) ** 2)
    left, back = outside.point(o.left, bottom, THICKNESS)[[0, 2]].tolist()
    right = float(outside.point(o.right, bottom)[0])
    builder.add(slab((left, bottom, back), (right, o.top, back + SHUTTER_THICKNESS)), furniture_material(rng))


def _partition(rng: Rng, width: float, z: float, height: float) -> Wall:
    """A wall between two rooms, with a door or a wide opening."""
    wide = float(rng.uniform(0.8, 1.2) if rng.random() < 0.4 else rng.uniform(1.2, width - 0.4))
    left = float(rng.uniform(0.2, width - wide - 0.2))
    top = float(rng.uniform(2.0, height - 0.1))
    return Wall(np.array([-width / 2, z]), np.array([width / 2, z]), height, (Opening(left, left + wide, 0.0, top),))


def _add_lights(rng: Rng, builder: GeneratedSceneBuilder, box: F64) -> None:
    """Add a few lights to a room, or spots aimed at its walls and objects."""
    count = int(rng.integers(1, 4))
    if rng.random() >= SPOT_PROBABILITY:
        add_local_lights(rng, builder, box, count)
        return
    for _ in range(count):
        at = rng.uniform(box[0] + 0.3, box[1] - 0.3)
        at[1] = box[1, 1] - rng.uniform(0.1, 0.5)
        phi, down = rng.uniform(0, 2 * math.pi), rng.uniform(0.1, 1.5)
        builder.lights.append(lights.spot(rng, at, np.array([math.cos(phi), -down, math.sin(phi)]), intensity=4.0))
