"""Open courtyards: walls and houses around a ground, an arcade, trees and things, the sun and a little sky."""

from __future__ import annotations

import numpy as np

from export.dataset.scenes import lights
from export.dataset.scenes.assembly import Assembly, Piece
from export.dataset.scenes.furniture import boxes, plant, table, vase
from export.dataset.scenes.generated_scene import GeneratedScene, Rng
from export.dataset.scenes.indoors import furnish, hang_lamps
from export.dataset.scenes.materials import floor, random_material, thing, wall
from export.dataset.scenes.parts import block, cylinder, slab, sphere
from export.dataset.scenes.walls import THICKNESS, build, rectangle, with_openings

NIGHT = 0.2


def courtyard(rng: Rng) -> GeneratedScene:
    """A yard of 8 to 20 metres along its sides, without a roof."""
    assembly = Assembly(rng)
    width, depth = rng.uniform(8, 20, 2).tolist()
    walls = [with_openings(rng, w, int(rng.integers(0, 5))) for w in rectangle(width, depth, 1.0)]
    heights = rng.uniform(2.2, 7.0, 4)
    walls = [type(w)(w.start, w.end, float(h), w.openings) for w, h in zip(walls, heights, strict=True)]
    build(assembly, walls, [wall(rng) for _ in walls])
    x, z, t = width / 2 + THICKNESS, depth / 2 + THICKNESS, THICKNESS
    assembly.add(slab((-x, -t, -z), (x, 0, z)), floor(rng))
    if rng.random() < 0.6:
        _arcade(rng, assembly, width, depth)
    for _ in range(rng.integers(0, 4)):
        at = (rng.uniform(-0.4, 0.4) * width, 0.0, rng.uniform(-0.4, 0.4) * depth)
        assembly.put(_tree(rng), 0.0, at, moves=rng.random() < 0.2)
    kinds = (boxes, plant, vase, table)
    furnish(rng, assembly, width, depth, lambda r: kinds[r.integers(len(kinds))](r), rng.uniform(0.03, 0.12))
    night = rng.random() < NIGHT
    if not night:
        assembly.lights.append(lights.sun(rng, lowest_deg=20.0, irradiance=12.0))
        if rng.random() < 0.5:
            assembly.lights += lights.sky(rng, int(rng.integers(3, 5)), 3.0)
    if night or rng.random() < 0.2:
        box = np.array([[-width / 2, 0, -depth / 2], [width / 2, 4.0, depth / 2]])
        hang_lamps(rng, assembly, box, int(rng.integers(1, 5)))
    free = [[-width / 2 + 0.4, 0.7, -depth / 2 + 0.4], [width / 2 - 0.4, 2.4, depth / 2 - 0.4]]
    return assembly.place("courtyard", [free])


def _arcade(rng: Rng, assembly: Assembly, width: float, depth: float) -> None:
    """A roof on posts along one side or two."""
    stone, roof, reach, height = wall(rng), random_material(rng), rng.uniform(1.5, 3.0), rng.uniform(2.3, 3.2)
    for sign in (-1, 1)[:rng.integers(1, 3)]:
        inner, outer = sign * (width / 2 - reach), sign * width / 2
        low, high = min(inner, outer), max(inner, outer)
        assembly.add(slab((low, height, -depth / 2), (high, height + 0.2, depth / 2)), roof)
        for at in np.linspace(-depth / 2 + 0.3, depth / 2 - 0.3, int(depth / rng.uniform(1.8, 3.5)) + 2):
            assembly.put([(block((0.25, height, 0.25)), stone)], 0.0, (inner, 0.0, float(at)))


def _tree(rng: Rng) -> list[Piece]:
    bark, leaves, height = thing(rng), thing(rng), rng.uniform(1.5, 3.5)
    pieces: list[Piece] = [(cylinder(rng.uniform(0.1, 0.25), height), bark)]
    for _ in range(rng.integers(1, 4)):
        at = (rng.uniform(-0.6, 0.6), height + rng.uniform(0, 0.8), rng.uniform(-0.6, 0.6))
        pieces.append((sphere(rng.uniform(0.5, 1.1), at, rows=8), leaves))
    return pieces
