"""Halls with rows of columns, galleries, and high windows."""

from __future__ import annotations

import math

import numpy as np

from export.dataset.scenes import lights
from export.dataset.scenes.assembly import Assembly
from export.dataset.scenes.furniture import random_furniture
from export.dataset.scenes.generated_scene import GeneratedScene, Rng
from export.dataset.scenes.indoors import furnish, hang_lamps
from export.dataset.scenes.materials import ceiling, floor, random_material, wall
from export.dataset.scenes.parts import block, cylinder, slab
from export.dataset.scenes.walls import THICKNESS, Opening, Wall, build, rectangle


def hall(rng: Rng) -> GeneratedScene:
    """A hall of 9 to 28 metres along its sides and 4.5 to 10 high, its roof open now and then."""
    assembly = Assembly(rng)
    width, depth = float(rng.uniform(9, 18)), float(rng.uniform(12, 28))
    height = float(rng.uniform(4.5, 10))
    walls = [_with_windows(rng, w) for w in rectangle(width, depth, height)]
    build(assembly, walls, [wall(rng)] * 4)
    x, z, t = width / 2 + THICKNESS, depth / 2 + THICKNESS, THICKNESS
    assembly.add(slab((-x, -t, -z), (x, 0, z)), floor(rng))
    roofed = rng.random() < 0.75
    if roofed:
        assembly.add(slab((-x, height, -z), (x, height + t, z)), ceiling(rng))
    else:  # a rim, so that light falls in through a rectangle
        rim, stone = rng.uniform(0.15, 0.4) * width, ceiling(rng)
        for sign in (-1, 1):
            edges = sorted((sign * x, sign * (x - rim)))
            assembly.add(slab((edges[0], height, -z), (edges[1], height + t, z)), stone)
    aisle = _columns(rng, assembly, width, depth, height)
    free = [[[-width / 2 + 0.5, 0.8, -depth / 2 + 0.5], [width / 2 - 0.5, 2.2, depth / 2 - 0.5]]]
    if rng.random() < 0.6:
        level = float(rng.uniform(2.8, 0.6 * height + 0.4))
        free += _gallery(rng, assembly, width, depth, level, aisle)
    furnish(rng, assembly, width, depth, random_furniture, per_area=rng.uniform(0.02, 0.08))
    if not roofed or rng.random() < 0.4:
        chosen = walls[rng.integers(4)]
        azimuth = math.atan2(chosen.inward[0], -chosen.inward[2]) + rng.uniform(-0.6, 0.6)
        assembly.lights.append(lights.sun(rng, azimuth, lowest_deg=20.0 if roofed else 40.0, irradiance=20.0))
    box = np.array([[-width / 2, 0, -depth / 2], [width / 2, min(height, 6.0), depth / 2]])
    hang_lamps(rng, assembly, box, int(rng.integers(0 if assembly.lights else 1, 6)))
    return assembly.place("hall", free)


def _with_windows(rng: Rng, plain: Wall) -> Wall:
    """A row of equal windows high up, on some walls."""
    if rng.random() < 0.5:
        return plain
    count = max(1, int(plain.length / rng.uniform(2.5, 5)))
    span = plain.length / count
    half, bottom = 0.5 * rng.uniform(0.25, 0.6) * span, rng.uniform(0.35, 0.55) * plain.height
    top = rng.uniform(0.75, 0.95) * plain.height
    openings = tuple(Opening((k + 0.5) * span - half, (k + 0.5) * span + half, bottom, top) for k in range(count))
    return Wall(plain.start, plain.end, plain.height, openings)


def _columns(rng: Rng, assembly: Assembly, width: float, depth: float, height: float) -> float:
    """Two rows along the hall; returns their distance from the long walls."""
    aisle = float(rng.uniform(0.18, 0.3)) * width
    count, radius = int(depth / rng.uniform(2.5, 5)), float(rng.uniform(0.2, 0.5))
    stone, foot, is_round = random_material(rng, 0.3, 0.9, metres=1.0), random_material(rng), rng.random() < 0.6
    for k in range(count):
        for sign in (-1, 1):
            at = (sign * (width / 2 - aisle), 0.0, -depth / 2 + (k + 0.5) * depth / count)
            shaft = cylinder(radius, height) if is_round else block((1.8 * radius, height, 1.8 * radius))
            assembly.put([(shaft, stone), (block((2.6 * radius, 0.3, 2.6 * radius)), foot)], 0.0, at)
    return aisle


def _gallery(rng: Rng, assembly: Assembly, width: float, depth: float, level: float,
             aisle: float) -> list[list[list[float]]]:
    """Floors above the aisles, with a parapet; where eyes may be on them."""
    stone, free = wall(rng), []
    for sign in (-1, 1):
        inner, outer = sign * (width / 2 - aisle), sign * width / 2
        low, high = min(inner, outer), max(inner, outer)
        assembly.add(slab((low, level - 0.25, -depth / 2), (high, level, depth / 2)), stone)
        assembly.add(slab((inner - 0.08, level, -depth / 2), (inner + 0.08, level + 0.9, depth / 2)), stone)
        free.append([[low + 0.4, level + 1.0, -depth / 2 + 0.5], [high - 0.4, level + 1.8, depth / 2 - 0.5]])
    return free
