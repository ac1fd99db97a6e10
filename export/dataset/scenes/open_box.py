"""Boxes that are open at one side and seen from there, so that most lit surfaces are in front of the camera."""

import math

import numpy as np

from export.dataset.scenes import lights
from export.dataset.scenes.furniture import boxes, random_furniture
from export.dataset.scenes.generated_scene import GeneratedScene, GeneratedSceneBuilder, Rng
from export.dataset.scenes.indoors import add_local_lights, furnish
from export.dataset.scenes.materials import ceiling_material, floor_material, wall_material
from export.dataset.scenes.walls import add_ceiling, add_floor, add_walls, rectangle

SUN_PROBABILITY = 0.25  # of sunlight through the open side


def open_box(rng: Rng) -> GeneratedScene:
    """A box of 1.5 to 6 metres along its sides, open towards +z and sometimes at the top, with one or two lights."""
    builder = GeneratedSceneBuilder(rng)
    width, depth = rng.uniform(1.5, 6.0, 2).tolist()
    height = float(rng.uniform(1.5, 3.6))
    walls = rectangle(width, depth, height)
    closed = [walls[0], walls[1], walls[3]]
    add_walls(builder, closed, [wall_material(rng) for _ in closed])
    add_floor(builder, width, depth, floor_material(rng))
    if rng.random() < 0.85:
        add_ceiling(builder, width, depth, height, ceiling_material(rng))
    kind = boxes if rng.random() < 0.5 else random_furniture
    furnish(rng, builder, width, depth, kind, per_area=rng.uniform(0.1, 0.5))
    add_local_lights(rng, builder, np.array([[-width / 2, 0, -depth / 2], [width / 2, height, depth / 2]]),
                     int(rng.integers(1, 3)))
    if rng.random() < SUN_PROBABILITY:
        builder.lights.append(lights.sun(rng, rng.uniform(-0.7, 0.7), irradiance=8.0))
    distance = max(width, height) * math.sqrt(0.5)
    return builder.build("open_box", [[[-width / 2, 0.3 * height, depth / 2 + 0.3 * distance],
                                       [width / 2, 0.9 * height, depth / 2 + 2 * distance]]])
