"""Open courtyards: walls around a ground with an arcade, trees and objects, lit by the sun and a sky."""

from dataclasses import replace

import numpy as np

from export.dataset.scenes import lights
from export.dataset.scenes.furniture import boxes, plant, table, vase
from export.dataset.scenes.generated_scene import GeneratedScene, GeneratedSceneBuilder, Pieces, Rng
from export.dataset.scenes.indoors import add_local_lights, furnish
from export.dataset.scenes.materials import floor_material, furniture_material, random_material, wall_material
from export.dataset.scenes.parts import block, cylinder, slab, sphere
from export.dataset.scenes.walls import add_floor, add_walls, rectangle, with_openings

NIGHT_PROBABILITY = 0.2


def courtyard(rng: Rng) -> GeneratedScene:
    """A yard of 8 to 20 metres along its sides, without a roof."""
    builder = GeneratedSceneBuilder(rng)
    width, depth = rng.uniform(8, 20, 2).tolist()
    walls = [with_openings(rng, w, int(rng.integers(0, 5))) for w in rectangle(width, depth, 1.0)]
    heights = rng.uniform(2.2, 7.0, 4)
    walls = [replace(w, height=float(h)) for w, h in zip(walls, heights, strict=True)]
    add_walls(builder, walls, [wall_material(rng) for _ in walls])
    add_floor(builder, width, depth, floor_material(rng))
    if rng.random() < 0.6:
        _add_arcade(rng, builder, width, depth)
    for _ in range(rng.integers(0, 4)):
        at = (rng.uniform(-0.4, 0.4) * width, 0.0, rng.uniform(-0.4, 0.4) * depth)
        builder.add_object(_tree(rng), 0.0, at, moves=rng.random() < 0.2)
    kinds = (boxes, plant, vase, table)
    furnish(rng, builder, width, depth, lambda r: kinds[r.integers(len(kinds))](r), rng.uniform(0.03, 0.12))
    night = rng.random() < NIGHT_PROBABILITY
    if not night:
        builder.lights.append(lights.sun(rng, min_elevation_deg=20.0, irradiance=12.0))
        if rng.random() < 0.5:
            builder.lights += lights.sky(rng, int(rng.integers(3, 5)), 3.0)
    if night or rng.random() < 0.2:
        box = np.array([[-width / 2, 0, -depth / 2], [width / 2, 4.0, depth / 2]])
        add_local_lights(rng, builder, box, int(rng.integers(1, 5)))
    x, z = width / 2 - 0.4, depth / 2 - 0.4
    return builder.build("courtyard", [[[-x, 0.7, -z], [x, 2.4, z]]])


def _add_arcade(rng: Rng, builder: GeneratedSceneBuilder, width: float, depth: float) -> None:
    """Add a roof on posts along one or two sides."""
    stone, roof, reach, height = wall_material(rng), random_material(rng), rng.uniform(1.5, 3.0), rng.uniform(2.3, 3.2)
    for sign in (-1, 1)[:rng.integers(1, 3)]:
        inner, outer = sign * (width / 2 - reach), sign * width / 2
        low, high = min(inner, outer), max(inner, outer)
        builder.add(slab((low, height, -depth / 2), (high, height + 0.2, depth / 2)), roof)
        for at in np.linspace(-depth / 2 + 0.3, depth / 2 - 0.3, int(depth / rng.uniform(1.8, 3.5)) + 2):
            builder.add_object([(block((0.25, height, 0.25)), stone)], 0.0, (inner, 0.0, float(at)))


def _tree(rng: Rng) -> Pieces:
    bark, leaves, height = furniture_material(rng), furniture_material(rng), rng.uniform(1.5, 3.5)
    pieces: Pieces = [(cylinder(rng.uniform(0.1, 0.25), height), bark)]
    for _ in range(rng.integers(1, 4)):
        at = (rng.uniform(-0.6, 0.6), height + rng.uniform(0, 0.8), rng.uniform(-0.6, 0.6))
        pieces.append((sphere(rng.uniform(0.5, 1.1), at, rows=8), leaves))
    return pieces
