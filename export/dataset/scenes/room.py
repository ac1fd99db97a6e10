"""Furnished rooms: four walls with windows and doors, furniture, lamps, and now and then the sun."""

from __future__ import annotations

import math

import numpy as np

from export.dataset.scenes import lights
from export.dataset.scenes.assembly import Assembly
from export.dataset.scenes.furniture import random_furniture
from export.dataset.scenes.generated_scene import GeneratedScene, Rng
from export.dataset.scenes.indoors import furnish, hang_lamps
from export.dataset.scenes.materials import ceiling, floor, thing, wall
from export.dataset.scenes.parts import slab
from export.dataset.scenes.walls import THICKNESS, Wall, build, rectangle, with_openings


def room(rng: Rng) -> GeneratedScene:
    """A room of 2.5 to 9 metres along its sides."""
    assembly = Assembly(rng)
    width, depth = rng.uniform(2.5, 9.0, 2).tolist()
    height = float(rng.uniform(2.3, 3.6))
    walls = [with_openings(rng, w, int(rng.choice(3, p=(0.55, 0.35, 0.1)))) for w in rectangle(width, depth, height)]
    paint = [wall(rng)] * 4 if rng.random() < 0.5 else [wall(rng) for _ in walls]
    build(assembly, walls, paint)
    x, z, t = width / 2 + THICKNESS, depth / 2 + THICKNESS, THICKNESS
    assembly.add(slab((-x, -t, -z), (x, 0, z)), floor(rng))
    if rng.random() < 0.93:
        assembly.add(slab((-x, height, -z), (x, height + t, z)), ceiling(rng))
    if rng.random() < 0.5:  # ground outside, which sends light in
        assembly.add(slab((-5 * x, -0.3 - t, -5 * z), (5 * x, -0.3, 5 * z)), floor(rng))
    furnish(rng, assembly, width, depth, random_furniture, per_area=rng.uniform(0.15, 0.6))
    _pictures(rng, assembly, walls)

    open_walls = [w for w in walls if w.openings]
    sunny = bool(open_walls) and rng.random() < 0.45
    if sunny:
        chosen = open_walls[rng.integers(len(open_walls))]
        azimuth = math.atan2(chosen.inward[0], -chosen.inward[2]) + rng.uniform(-0.7, 0.7)
        assembly.lights.append(lights.sun(rng, azimuth, irradiance=25.0))
    if open_walls and rng.random() < 0.3:
        for w in open_walls:
            o = w.openings[0]
            at = w.point((o.left + o.right) / 2, (o.bottom + o.top) / 2, THICKNESS + 0.02)
            assembly.lights.append(lights.window(rng, at, w.inward, (o.right - o.left, o.top - o.bottom), 6.0))
    fewest = 0 if assembly.lights else 1
    hang_lamps(rng, assembly, np.array([[-width / 2, 0, -depth / 2], [width / 2, height, depth / 2]]),
               int(rng.integers(fewest, 4)))
    free = [[-width / 2 + 0.25, 0.5, -depth / 2 + 0.25], [width / 2 - 0.25, min(2.1, height - 0.2), depth / 2 - 0.25]]
    return assembly.place("room", [free])


def _pictures(rng: Rng, assembly: Assembly, walls: list[Wall]) -> None:
    """Flat boards on walls without openings."""
    for w in walls:
        if w.openings or rng.random() < 0.4:
            continue
        size, middle, up = rng.uniform(0.3, 1.4), rng.uniform(0.2, 0.8) * w.length, rng.uniform(1.0, 1.7)
        low, high = w.point(middle - size / 2, up - size / 3, 0.0), w.point(middle + size / 2, up + size / 3, -0.03)
        box = np.stack([np.minimum(low, high), np.maximum(low, high)])
        assembly.add(slab(tuple(box[0].tolist()), tuple(box[1].tolist())), thing(rng))
