"""Boxes that are open at one side and seen from there, as a stage: nearly all that is lit is in front of the camera."""

from __future__ import annotations

import math

import numpy as np

from export.dataset.scenes import lights
from export.dataset.scenes.assembly import Assembly
from export.dataset.scenes.furniture import boxes, random_furniture
from export.dataset.scenes.generated_scene import GeneratedScene, Rng
from export.dataset.scenes.indoors import furnish, hang_lamps
from export.dataset.scenes.materials import ceiling, floor, wall
from export.dataset.scenes.parts import slab
from export.dataset.scenes.walls import THICKNESS, build, rectangle

SUNNY = 0.25  # share of those that the sun lights through the open side, too


def open_box(rng: Rng) -> GeneratedScene:
    """A box of 1.5 to 6 metres along its sides, open towards +z and now and then above, and a lamp or two in it."""
    assembly = Assembly(rng)
    width, depth = rng.uniform(1.5, 6.0, 2).tolist()
    height = float(rng.uniform(1.5, 3.6))
    walls = rectangle(width, depth, height)
    closed = [walls[0], walls[1], walls[3]]
    build(assembly, closed, [wall(rng) for _ in closed])
    x, z, t = width / 2 + THICKNESS, depth / 2 + THICKNESS, THICKNESS
    assembly.add(slab((-x, -t, -z), (x, 0, z)), floor(rng))
    if rng.random() < 0.85:
        assembly.add(slab((-x, height, -z), (x, height + t, z)), ceiling(rng))
    kind = boxes if rng.random() < 0.5 else random_furniture
    furnish(rng, assembly, width, depth, kind, per_area=rng.uniform(0.1, 0.5))
    hang_lamps(rng, assembly, np.array([[-width / 2, 0, -depth / 2], [width / 2, height, depth / 2]]),
               int(rng.integers(1, 3)))
    if rng.random() < SUNNY:
        assembly.lights.append(lights.sun(rng, rng.uniform(-0.7, 0.7), irradiance=8.0))
    away = max(width, height) * math.sqrt(0.5)
    free = [[-width / 2, 0.3 * height, depth / 2 + 0.3 * away], [width / 2, 0.9 * height, depth / 2 + 2 * away]]
    return assembly.place("open_box", [free])
