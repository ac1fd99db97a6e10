"""Rooms with small things: mouldings along the walls, panels, crowded tables, shelves, lamps with shades."""

from functools import partial

import numpy as np

from app.arrays import F64
from app.math3d import translation
from export.dataset.scenes import lights
from export.dataset.scenes.curved import SMALL, STANDING
from export.dataset.scenes.furniture import chair, random_furniture, shelf, table
from export.dataset.scenes.generated_scene import GeneratedScene, GeneratedSceneBuilder, Pieces, Rng
from export.dataset.scenes.indoors import add_local_lights, furnish
from export.dataset.scenes.materials import (
    ceiling_material,
    emissive_material,
    floor_material,
    furniture_material,
    wall_material,
)
from export.dataset.scenes.parts import Part, block, cylinder, merge, slab, sphere
from export.dataset.scenes.walls import Wall, add_ceiling, add_floor, add_walls, rectangle, with_openings


def cluttered_room(rng: Rng) -> GeneratedScene:
    """A room of 2.5 to 6 metres along its sides, with twice the furniture of ``room``."""
    builder = GeneratedSceneBuilder(rng)
    width, depth = rng.uniform(2.5, 6.0, 2).tolist()
    height = float(rng.uniform(2.3, 3.2))
    walls = [with_openings(rng, w, int(rng.choice(3, p=(0.5, 0.4, 0.1)))) for w in rectangle(width, depth, height)]
    add_walls(builder, walls, [wall_material(rng)] * 4 if rng.random() < 0.5 else [wall_material(rng) for _ in walls])
    add_floor(builder, width, depth, floor_material(rng))
    add_ceiling(builder, width, depth, height, ceiling_material(rng))
    for wall in walls:
        _add_mouldings(rng, builder, wall)
    furnish(rng, builder, width, depth, partial(_crowded, height=height), per_area=rng.uniform(0.6, 1.2))
    open_walls = [w for w in walls if w.openings]
    if open_walls and rng.random() < 0.5:
        azimuth = open_walls[rng.integers(len(open_walls))].inward_azimuth + rng.uniform(-0.7, 0.7)
        builder.lights.append(lights.sun(rng, azimuth, irradiance=25.0))
    for _ in range(rng.integers(0, 3)):
        _add_lit_strip(rng, builder, walls[rng.integers(4)])
    add_local_lights(rng, builder, np.array([[-width / 2, 0, -depth / 2], [width / 2, height, depth / 2]]),
                     int(rng.integers(0 if builder.lights else 1, 3)))
    x, z = width / 2 - 0.25, depth / 2 - 0.25
    return builder.build("cluttered_room", [[[-x, 0.5, -z], [x, min(2.1, height - 0.2), z]]])


def _add_mouldings(rng: Rng, builder: GeneratedSceneBuilder, wall: Wall) -> None:
    """A skirting board, a cornice, and raised panels on a wall without openings."""
    wood = furniture_material(rng)
    if not wall.openings:
        builder.add(_on_wall(wall, 0.0, wall.length, 0.0, rng.uniform(0.06, 0.2), 0.02), wood)
        for k in range(rng.integers(0, 5)):
            step = wall.length / 5
            builder.add(_on_wall(wall, (k + 0.1) * step, (k + 0.9) * step, 0.3, rng.uniform(0.8, 1.8), 0.025), wood)
    if rng.random() < 0.6:
        builder.add(_on_wall(wall, 0.0, wall.length, wall.height - rng.uniform(0.05, 0.15), wall.height,
                             rng.uniform(0.03, 0.1)), wood)


def _add_lit_strip(rng: Rng, builder: GeneratedSceneBuilder, wall: Wall) -> None:
    """An emissive strip behind a board that stands off the wall, which so hides it."""
    left = rng.uniform(0.1, 0.5) * wall.length
    right, up = min(left + rng.uniform(0.4, 1.5), wall.length - 0.1), rng.uniform(0.8, 2.0)
    radiance = lights.random_light_color(rng, 3.0)
    builder.add(_on_wall(wall, left, right, up, up + 0.03, 0.03), emissive_material(radiance))
    board = _on_wall(wall, left - 0.1, right + 0.1, up - 0.1, up + 0.15, 0.15, behind=0.12)
    builder.add(board, furniture_material(rng))


def _on_wall(wall: Wall, left: float, right: float, bottom: float, top: float, front: float,
             behind: float = 0.0) -> Part:
    """A board parallel to a wall, between two distances from it."""
    a, b = wall.point(left, bottom, -behind), wall.point(right, top, -front)
    low, high = np.minimum(a, b).tolist(), np.maximum(a, b).tolist()
    return slab(tuple(low), tuple(high))


def _crowded(rng: Rng, height: float) -> Pieces:
    """Furniture below a ceiling, with things on, below or beside it; something curved, or a lamp."""
    kind = rng.integers(9)
    if kind == 0:
        return _floor_lamp(rng)
    if kind > 5:
        return STANDING[rng.integers(len(STANDING))](rng)
    pieces = (table, shelf, chair, random_furniture, random_furniture)[kind - 1](rng)
    low, high = _bounds(pieces)
    for _ in range(rng.integers(2, 9)):
        thing = _small_thing(rng)
        least, most = _bounds(thing)
        room = low - least, high - most  # for its origin
        x, z = (float(rng.uniform(room[0][axis], max(room[1][axis], room[0][axis]))) for axis in (0, 2))
        y = 0.0 if rng.random() < 0.3 else float(high[1])
        if (room[0] <= room[1])[[0, 2]].all() and y + most[1] < height:
            pieces += [(part.transformed(translation(np.array([x, y, z]))), material) for part, material in thing]
    return pieces


def _small_thing(rng: Rng) -> Pieces:
    if rng.random() < 0.4:
        return SMALL[rng.integers(len(SMALL))](rng)
    size, tall = float(rng.uniform(0.02, 0.12)), float(rng.uniform(0.02, 0.3))
    part = (block((2 * size, tall, 1.3 * size)), cylinder(size, tall),
            sphere(size, (0.0, size, 0.0), rows=6))[rng.integers(3)]
    return [(part, furniture_material(rng))]


def _bounds(pieces: Pieces) -> F64:
    return merge([part for part, _ in pieces]).bounds


def _floor_lamp(rng: Rng) -> Pieces:
    """An emissive sphere over a thin pole, half hidden by a board."""
    height, metal = float(rng.uniform(0.9, 1.7)), furniture_material(rng)
    radiance = lights.random_light_color(rng, 8.0)
    return [(cylinder(0.015, height), metal), (cylinder(0.14, 0.02), metal),
            (sphere(0.08, (0.0, height + 0.08, 0.0), rows=8), emissive_material(radiance)),
            (block((0.3, 0.02, 0.3), (0.0, height + 0.18, 0.0)), metal)]
