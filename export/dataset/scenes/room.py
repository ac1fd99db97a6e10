"""Furnished rooms: four walls with windows and doors, furniture, lights, and sometimes the sun."""

import numpy as np

from export.dataset.scenes import lights
from export.dataset.scenes.furniture import random_furniture
from export.dataset.scenes.generated_scene import GeneratedScene, GeneratedSceneBuilder, Rng
from export.dataset.scenes.indoors import add_local_lights, furnish
from export.dataset.scenes.materials import ceiling_material, floor_material, furniture_material, wall_material
from export.dataset.scenes.parts import slab
from export.dataset.scenes.walls import THICKNESS, Wall, add_ceiling, add_floor, add_walls, rectangle, with_openings


def room(rng: Rng) -> GeneratedScene:
    """A room of 2.5 to 9 metres along its sides."""
    builder = GeneratedSceneBuilder(rng)
    width, depth = rng.uniform(2.5, 9.0, 2).tolist()
    height = float(rng.uniform(2.3, 3.6))
    walls = [with_openings(rng, w, int(rng.choice(3, p=(0.55, 0.35, 0.1)))) for w in rectangle(width, depth, height)]
    add_walls(builder, walls, [wall_material(rng)] * 4 if rng.random() < 0.5 else [wall_material(rng) for _ in walls])
    add_floor(builder, width, depth, floor_material(rng))
    if rng.random() < 0.93:
        add_ceiling(builder, width, depth, height, ceiling_material(rng))
    if rng.random() < 0.5:  # ground outside, which reflects light into the room
        x, z = width / 2 + THICKNESS, depth / 2 + THICKNESS
        builder.add(slab((-5 * x, -0.3 - THICKNESS, -5 * z), (5 * x, -0.3, 5 * z)), floor_material(rng))
    furnish(rng, builder, width, depth, random_furniture, per_area=rng.uniform(0.15, 0.6))
    _hang_pictures(rng, builder, walls)

    open_walls = [w for w in walls if w.openings]
    if open_walls and rng.random() < 0.45:
        azimuth = open_walls[rng.integers(len(open_walls))].inward_azimuth + rng.uniform(-0.7, 0.7)
        builder.lights.append(lights.sun(rng, azimuth, irradiance=25.0))
    if open_walls and rng.random() < 0.3:
        for w in open_walls:
            o = w.openings[0]
            at = w.point((o.left + o.right) / 2, (o.bottom + o.top) / 2, THICKNESS + 0.02)
            builder.lights.append(lights.window(rng, at, w.inward, (o.right - o.left, o.top - o.bottom), 6.0))
    add_local_lights(rng, builder, np.array([[-width / 2, 0, -depth / 2], [width / 2, height, depth / 2]]),
                     int(rng.integers(0 if builder.lights else 1, 4)))
    x, z = width / 2 - 0.25, depth / 2 - 0.25
    return builder.build("room", [[[-x, 0.5, -z], [x, min(2.1, height - 0.2), z]]])


def _hang_pictures(rng: Rng, builder: GeneratedSceneBuilder, walls: list[Wall]) -> None:
    """Hang flat boards on walls without openings."""
    for w in walls:
        if w.openings or rng.random() < 0.4:
            continue
        size, along, up = rng.uniform(0.3, 1.4), rng.uniform(0.2, 0.8) * w.length, rng.uniform(1.0, 1.7)
        a, b = w.point(along - size / 2, up - size / 3, 0.0), w.point(along + size / 2, up + size / 3, -0.03)
        low, high = np.minimum(a, b).tolist(), np.maximum(a, b).tolist()
        builder.add(slab(tuple(low), tuple(high)), furniture_material(rng))
