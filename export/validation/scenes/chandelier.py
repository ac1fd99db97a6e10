"""A room lit by a chandelier of hundreds of small emissive pieces, and by light-emitting diodes in a shelf."""

import math

import numpy as np

from app.math3d import translation
from app.scene import Material
from app.simple_meshes import rotation_about_y
from export.dataset.scenes.generated_scene import GeneratedScene, GeneratedSceneBuilder, Pieces, Rng
from export.dataset.scenes.parts import Part, Triple, block, cylinder, merge, sphere
from export.dataset.scenes.walls import rectangle
from export.validation.scenes.interior import (
    add_shell,
    dining_table,
    emitter,
    furnish_statically,
    lacquer,
    metal,
    reserve_camera,
)

TIERS = 3
TUBE_RADIUS, BULB_RADIUS, BEAD_RADIUS, DIODE = 0.006, 0.014, 0.007, 0.008  # metres, like all lengths here
TUBE_SPAN = 0.8               # of the arc between two tubes of a ring
TUBE_STEPS, TUBE_SIDES = 5, 6
BULB_RADIANCE, TUBE_RADIANCE, BEAD_RADIANCE, DIODE_RADIANCE = 50.0, 70.0, 30.0, 20.0  # W/(sr m²), mean


def chandelier(rng: Rng) -> GeneratedScene:
    """A room with a table below a chandelier, and a shelf whose boards have rows of diodes."""
    builder = GeneratedSceneBuilder(rng)
    width, depth, height = (float(x) for x in rng.uniform((4.0, 4.2, 2.9), (5.2, 5.6, 3.4)))
    add_shell(rng, builder, rectangle(width, depth, height), width, depth)
    at = (float(rng.uniform(-0.4, 0.4)), 0.0, float(rng.uniform(-0.4, 0.4)))
    builder.add_object(dining_table(rng), float(rng.uniform(0, math.pi)), at)
    hanging = height - float(rng.uniform(0.9, 1.1))
    for part, material in _chandelier(rng, height - hanging):
        builder.add(part.transformed(translation(np.add(at, (0.0, hanging, 0.0)))), material)
    builder.blocked_volumes.append(np.add(at, [[-0.9, hanging - 0.5, -0.9], [0.9, height, 0.9]]))
    side = 1 if rng.random() < 0.5 else -1
    builder.add_object(_diode_shelf(rng), -side * math.pi / 2,
                       (side * (width / 2 - 0.2), 0.0, float(rng.uniform(-0.25, 0.25)) * depth))
    camera = reserve_camera(builder, (-side * (width / 2 - 0.4), 1.5, depth / 2 - 0.4),
                            (at[0] + side * 0.3, 1.5, at[2]))
    furnish_statically(rng, builder, width, depth, 0.35)
    x, z = width / 2 - 0.3, depth / 2 - 0.3
    return builder.build("chandelier", [[[-x, 0.9, -z], [x, 1.9, z]]], camera)


def _chandelier(rng: Rng, drop: float) -> Pieces:
    """A chandelier around the origin, which hangs ``drop`` below the ceiling: at least 200 emissive pieces.

    Each of its rings carries curved tubes and bulbs; strands of beads hang between the rings and below the lowest.
    """
    brass = metal(rng)
    bulbs, beads = emitter(rng, BULB_RADIANCE), emitter(rng, BEAD_RADIANCE)
    tubes = emitter(rng, TUBE_RADIANCE, saturated=0.3)
    pieces: Pieces = [(cylinder(0.012, drop, sides=10), brass), (cylinder(0.06, 0.03, (0, drop - 0.03, 0)), brass),
                      (sphere(0.05, rows=8), brass)]
    for tier in range(TIERS):
        radius = 0.62 - 0.19 * tier + float(rng.uniform(-0.02, 0.02))
        y = 0.3 - 0.24 * tier
        pieces += [(_torus_arc(radius, 0.009, 0.0, 2 * math.pi, 40, y), brass),
                   *((_spoke(radius, y, angle), brass) for angle in np.arange(4) * math.pi / 2)]
        count = int(rng.integers(30, 36)) - 7 * tier
        for k in range(count):
            angle, turn = 2 * math.pi * k / count, 2 * math.pi / count
            x, z = radius * math.sin(angle), radius * math.cos(angle)
            pieces += [(cylinder(0.007, 0.05, (x, y, z), sides=8), brass), (_bulb((x, y + 0.05, z)), bulbs),
                       (_torus_arc(radius + 0.03, TUBE_RADIUS, angle, angle + TUBE_SPAN * turn, TUBE_STEPS, y - 0.02),
                        tubes)]
            pieces += [(sphere(BEAD_RADIUS, (x, y - 0.05 - 0.03 * bead, z), rows=4), beads)
                       for bead in range(int(rng.integers(1, 4)))]
    return pieces


def _bulb(at: Triple) -> Part:
    """A flame-shaped bulb: an ellipsoid three times as high as it is wide, standing at ``at``."""
    ball = sphere(BULB_RADIUS, rows=6)
    stretched = ball.positions * (1.0, 2.2, 1.0) + at + np.array([0.0, 2.2 * BULB_RADIUS, 0.0])
    normals = ball.normals / (1.0, 2.2, 1.0)
    return Part(stretched, normals / np.linalg.norm(normals, axis=1, keepdims=True), ball.uvs, ball.triangles)


def _torus_arc(radius: float, thickness: float, start: float, end: float, steps: int, y: float) -> Part:
    """A tube of radius ``thickness`` bent about the y axis from angle ``start`` to ``end``, with closed ends."""
    u, v = np.meshgrid(np.linspace(start, end, steps + 1), np.linspace(0, 2 * math.pi, TUBE_SIDES + 1), indexing="ij")
    outward = np.stack([np.sin(u), np.zeros_like(u), np.cos(u)], axis=-1)
    normals = np.cos(v)[..., None] * outward + np.sin(v)[..., None] * np.array([0.0, 1.0, 0.0])
    points = radius * outward + thickness * normals + np.array([0.0, y, 0.0])
    k = (np.arange(steps)[:, None] * (TUBE_SIDES + 1) + np.arange(TUBE_SIDES)).ravel()
    across = k + TUBE_SIDES + 1
    triangles = np.concatenate([np.stack([k, across, across + 1], 1), np.stack([k, across + 1, k + 1], 1)])
    hull = Part(points.reshape(-1, 3), normals.reshape(-1, 3), np.stack([u * radius, v * thickness], -1).reshape(-1, 2),
                triangles)
    if end - start > 2 * math.pi - 1e-6:
        return hull
    fan = np.stack([np.zeros(TUBE_SIDES - 2, np.int64), np.arange(1, TUBE_SIDES - 1), np.arange(2, TUBE_SIDES)], axis=1)
    caps = []
    for row, sign in ((points[0], -1.0), (points[-1], 1.0)):
        angle = start if sign < 0 else end
        facing = sign * np.array([math.cos(angle), 0.0, -math.sin(angle)])
        caps.append(Part(row[:-1], np.tile(facing, (TUBE_SIDES, 1)), np.zeros((TUBE_SIDES, 2)),
                         fan if sign < 0 else fan[:, ::-1]))
    return merge([hull, *caps])


def _spoke(radius: float, y: float, angle: float) -> Part:
    """A thin bar from the axis to the ring."""
    return block((0.012, 0.012, radius), (0.0, y - 0.006, radius / 2)).transformed(rotation_about_y(angle))


def _diode_shelf(rng: Rng) -> Pieces:
    """A bookshelf without books, whose boards have a row of diodes at the front of their underside."""
    wood, levels = lacquer(rng), 4
    width, depth, pitch = float(rng.uniform(1.1, 1.5)), 0.32, 0.4
    pieces: Pieces = [(block((0.025, levels * pitch, depth), (s * width / 2, 0, 0)), wood) for s in (-1, 1)]
    pieces += [(block((width, 0.025, depth), (0, k * pitch, 0)), wood) for k in range(levels + 1)]
    pieces.append((block((width, levels * pitch, 0.012), (0, 0, -depth / 2)), wood))
    for k in range(1, levels + 1):
        color = emitter(rng, DIODE_RADIANCE, saturated=0.6)
        xs = np.arange(-width / 2 + 0.05, width / 2 - 0.04, 0.05).tolist()
        pieces += [(block((DIODE, DIODE, DIODE), (x, k * pitch - DIODE, depth / 2 - 0.03)), color) for x in xs]
        pieces += _ornaments(rng, width, k * pitch - pitch + 0.025)
    return pieces


def _ornaments(rng: Rng, width: float, y: float) -> list[tuple[Part, Material]]:
    """A vase and a box on a board."""
    x, size = rng.uniform(0.1, 0.4, 2) * width, rng.uniform(0.05, 0.1, 2)
    return [(sphere(size[0], (-x[0], y + size[0], 0.0), rows=8), lacquer(rng)),
            (block((size[1], 2 * size[1], size[1]), (x[1], y, 0.0)), lacquer(rng))]
