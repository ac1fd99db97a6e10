"""Halls with rows of columns, galleries, and high windows."""

from dataclasses import replace

import numpy as np

from export.dataset.scenes import lights
from export.dataset.scenes.furniture import random_furniture
from export.dataset.scenes.generated_scene import GeneratedScene, GeneratedSceneBuilder, Rng
from export.dataset.scenes.indoors import add_local_lights, furnish
from export.dataset.scenes.materials import ceiling_material, floor_material, random_material, wall_material
from export.dataset.scenes.parts import block, cylinder, slab
from export.dataset.scenes.walls import THICKNESS, Opening, Wall, add_ceiling, add_floor, add_walls, rectangle


def hall(rng: Rng) -> GeneratedScene:
    """A hall of 9 to 28 metres along its sides and 4.5 to 10 high, a quarter of them with an open roof."""
    builder = GeneratedSceneBuilder(rng)
    width, depth = float(rng.uniform(9, 18)), float(rng.uniform(12, 28))
    height = float(rng.uniform(4.5, 10))
    walls = [_with_windows(rng, w) for w in rectangle(width, depth, height)]
    add_walls(builder, walls, [wall_material(rng)] * 4)
    add_floor(builder, width, depth, floor_material(rng))
    roofed = rng.random() < 0.75
    if roofed:
        add_ceiling(builder, width, depth, height, ceiling_material(rng))
    else:  # a rim on both sides, so that light enters through a rectangle
        x, z = width / 2 + THICKNESS, depth / 2 + THICKNESS
        rim, stone = rng.uniform(0.15, 0.4) * width, ceiling_material(rng)
        for sign in (-1, 1):
            left, right = sorted((sign * x, sign * (x - rim)))
            builder.add(slab((left, height, -z), (right, height + THICKNESS, z)), stone)
    aisle = _add_columns(rng, builder, width, depth, height)
    camera_volumes = [[[-width / 2 + 0.5, 0.8, -depth / 2 + 0.5], [width / 2 - 0.5, 2.2, depth / 2 - 0.5]]]
    if rng.random() < 0.6:
        level = float(rng.uniform(2.8, 0.6 * height + 0.4))
        camera_volumes += _add_galleries(rng, builder, width, depth, level, aisle)
    furnish(rng, builder, width, depth, random_furniture, per_area=rng.uniform(0.02, 0.08))
    if not roofed or rng.random() < 0.4:
        azimuth = walls[rng.integers(4)].inward_azimuth + rng.uniform(-0.6, 0.6)
        builder.lights.append(lights.sun(rng, azimuth, 20.0 if roofed else 40.0, irradiance=20.0))
    box = np.array([[-width / 2, 0, -depth / 2], [width / 2, min(height, 6.0), depth / 2]])
    add_local_lights(rng, builder, box, int(rng.integers(0 if builder.lights else 1, 6)))
    return builder.build("hall", camera_volumes)


def _with_windows(rng: Rng, wall: Wall) -> Wall:
    """The wall, half the time with a row of equal windows high up."""
    if rng.random() < 0.5:
        return wall
    count = max(1, int(wall.length / rng.uniform(2.5, 5)))
    span = wall.length / count
    half, bottom = 0.5 * rng.uniform(0.25, 0.6) * span, rng.uniform(0.35, 0.55) * wall.height
    top = rng.uniform(0.75, 0.95) * wall.height
    openings = tuple(Opening((k + 0.5) * span - half, (k + 0.5) * span + half, bottom, top) for k in range(count))
    return replace(wall, openings=openings)


def _add_columns(rng: Rng, builder: GeneratedSceneBuilder, width: float, depth: float, height: float) -> float:
    """Add two rows of columns along the hall; returns their distance from the long walls."""
    aisle = float(rng.uniform(0.18, 0.3)) * width
    count, radius = int(depth / rng.uniform(2.5, 5)), float(rng.uniform(0.2, 0.5))
    stone, foot, is_round = random_material(rng, 0.3, 0.9, metres=1.0), random_material(rng), rng.random() < 0.6
    for k in range(count):
        for sign in (-1, 1):
            at = (sign * (width / 2 - aisle), 0.0, -depth / 2 + (k + 0.5) * depth / count)
            shaft = cylinder(radius, height) if is_round else block((1.8 * radius, height, 1.8 * radius))
            builder.add_object([(shaft, stone), (block((2.6 * radius, 0.3, 2.6 * radius)), foot)], 0.0, at)
    return aisle


def _add_galleries(rng: Rng, builder: GeneratedSceneBuilder, width: float, depth: float, level: float,
                   aisle: float) -> list[list[list[float]]]:
    """Add floors with parapets above the aisles; returns the camera volumes on them."""
    stone, camera_volumes = wall_material(rng), []
    for sign in (-1, 1):
        inner, outer = sign * (width / 2 - aisle), sign * width / 2
        low, high = min(inner, outer), max(inner, outer)
        builder.add(slab((low, level - 0.25, -depth / 2), (high, level, depth / 2)), stone)
        builder.add(slab((inner - 0.08, level, -depth / 2), (inner + 0.08, level + 0.9, depth / 2)), stone)
        camera_volumes.append([[low + 0.4, level + 1.0, -depth / 2 + 0.5], [high - 0.4, level + 1.8, depth / 2 - 0.5]])
    return camera_volumes
