"""An archway to a room with large emissive panes, and a stair with a space below it in the room before the arch."""

import math
from itertools import pairwise

import numpy as np

from app.arrays import F64
from export.dataset.scenes.furniture import boxes
from export.dataset.scenes.generated_scene import GeneratedScene, GeneratedSceneBuilder, Rng
from export.dataset.scenes.parts import Part, cylinder, merge, slab
from export.dataset.scenes.walls import THICKNESS, rectangle
from export.validation.scenes.interior import (
    add_shell,
    emissive_pane,
    furnish_statically,
    lacquer,
    metal,
    partition,
    reserve_camera,
)

ARCH_SEGMENTS = 24
RISE, GOING, STAIR_WIDTH = 0.17, 0.27, 0.95  # metres, like all lengths here
TREAD, RISER = 0.035, 0.018                  # thicknesses
STEPS = 9                                    # up to the landing
RAIL_HEIGHT = 0.9
RADIANCE = 9.0                               # W/(sr m²), mean


def archway_stair(rng: Rng) -> GeneratedScene:
    """A bright room at -z and a hall at +z with a wall between them, in which the arch is."""
    builder = GeneratedSceneBuilder(rng)
    width, height = float(rng.uniform(4.6, 5.8)), float(rng.uniform(3.5, 3.9))
    bright_depth, hall_depth = (float(d) for d in rng.uniform((3.4, 4.6), (4.4, 5.4)))
    front, back = (bright_depth + hall_depth) / 2, -(bright_depth + hall_depth) / 2
    arch = back + bright_depth  # z of the front of the wall with the arch
    side = 1 if rng.random() < 0.5 else -1  # where the stair is
    radius, spring = float(rng.uniform(0.6, 0.85)), float(rng.uniform(1.4, 1.65))
    middle = -side * float(rng.uniform(0.7, width / 2 - radius - 0.5))
    wall = partition(width, arch, height, middle - radius, middle + radius, spring + radius)
    paint = add_shell(rng, builder, [*rectangle(width, front - back, height), wall], width, front - back)[-1]
    builder.add(_spandrels(middle, radius, spring, arch - THICKNESS, arch), paint)
    _add_panes(rng, builder, width, back, height)
    _add_stair(rng, builder, side, width / 2, front)

    landing = front - STAIR_WIDTH
    below = (side * (width / 2 - STAIR_WIDTH / 2), 0.0, landing - 0.2)
    builder.add_object(boxes(rng), float(rng.uniform(0, 0.5)), below)
    camera = reserve_camera(builder, (-side * (width / 2 - 0.4), 1.6, arch + 0.3 * hall_depth),
                            (side * width / 2, 1.0, landing - 4 * GOING))
    furnish_statically(rng, builder, width - STAIR_WIDTH - 0.2, hall_depth - 0.6, 0.25,
                       (-side * (STAIR_WIDTH / 2 + 0.1), arch + hall_depth / 2 + 0.3))
    furnish_statically(rng, builder, width - 0.6, bright_depth - 1.0, 0.25, (0.0, back + bright_depth / 2 + 0.2))
    edges = sorted((-side * (width / 2 - 0.3), side * (width / 2 - STAIR_WIDTH - 0.2)))
    hall = [[edges[0], 1.0, arch + 0.8], [edges[1], 2.0, front - 0.3]]
    return builder.build("archway_stair", [hall], camera)


def _spandrels(middle: float, radius: float, spring: float, back: float, front: float) -> Part:
    """What fills a rectangular opening above a semicircular arch; its soffit has smooth normals."""
    phi = np.linspace(0, math.pi, ARCH_SEGMENTS + 1)
    x, y, top = middle - radius * np.cos(phi), spring + radius * np.sin(phi), spring + radius
    pieces = []
    for (x0, y0, a), (x1, y1, b) in pairwise(zip(x.tolist(), y.tolist(), phi.tolist(), strict=True)):
        for z, order in ((front, (0, 1, 2, 3)), (back, (1, 0, 3, 2))):
            corners = np.array([(x0, y0, z), (x1, y1, z), (x1, top, z), (x0, top, z)])[list(order)]
            pieces.append(_quadrangle(corners, np.tile((0.0, 0.0, 1.0 if z == front else -1.0), (4, 1))))
        inward = [(math.cos(angle), -math.sin(angle), 0.0) for angle in (a, a, b, b)]
        pieces.append(_quadrangle(np.array([(x0, y0, front), (x0, y0, back), (x1, y1, back), (x1, y1, front)]),
                                  np.array(inward)))
    return merge(pieces)


def _quadrangle(corners: F64, normals: F64) -> Part:
    """A flat quadrangle, corners and normals of shape (4, 3), that may have a side without length."""
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    a, b = corners[triangles[:, 1]] - corners[triangles[:, 0]], corners[triangles[:, 2]] - corners[triangles[:, 0]]
    has_area = np.linalg.norm(np.cross(a, b), axis=1) > 1e-9
    return Part(corners, normals, corners[:, :2], triangles[has_area])


def _add_panes(rng: Rng, builder: GeneratedSceneBuilder, width: float, back: float, height: float) -> None:
    """Add two or three tall emissive panes with frames on the wall at z = ``back``."""
    frame, count = metal(rng), int(rng.integers(2, 4))
    pitch = width / count
    wide, low, high = 0.72 * pitch, float(rng.uniform(0.3, 0.6)), height - float(rng.uniform(0.6, 0.9))
    for k in range(count):
        x = -width / 2 + (k + 0.5) * pitch - wide / 2
        builder.add(*emissive_pane(rng, RADIANCE, (x, low, back + 0.02), (wide, 0, 0), (0, high - low, 0)))
        for a, b in (((x - 0.05, low - 0.05), (x + wide + 0.05, low)),
                     ((x - 0.05, high), (x + wide + 0.05, high + 0.05)),
                     ((x - 0.05, low), (x, high)), ((x + wide, low), (x + wide + 0.05, high)),
                     *(((x + share * wide - 0.02, low), (x + share * wide + 0.02, high)) for share in (1 / 3, 2 / 3))):
            builder.add(slab((*a, back), (*b, back + 0.06)), frame)


def _add_stair(rng: Rng, builder: GeneratedSceneBuilder, side: int, wall: float, front: float) -> None:
    """Add a straight flight along the wall at x = ``side`` · ``wall`` up to a landing at z = ``front``, with a rail.

    The flight is open below, so that there is a space under it and under the landing.
    """
    wood, board, iron = lacquer(rng), lacquer(rng), metal(rng)
    inner, outer = sorted((side * wall, side * (wall - STAIR_WIDTH)))
    free = side * (wall - STAIR_WIDTH)  # the edge at the hall
    landing = front - STAIR_WIDTH
    first = landing - (STEPS - 1) * GOING
    for k in range(STEPS - 1):
        z, y = first + k * GOING, (k + 1) * RISE
        builder.add(slab((inner, y - TREAD, z - 0.02), (outer, y, z + GOING)), wood)
        builder.add(slab((inner, y - RISE, z), (outer, y - TREAD, z + RISER)), board)
        builder.add(cylinder(0.01, RAIL_HEIGHT, (free + side * 0.04, y, z + GOING / 2), sides=8), iron)
    top = STEPS * RISE
    builder.add(slab((inner, top - 0.12, landing), (outer, top, front)), wood)
    builder.add(slab((inner, top - RISE, landing - 0.002), (outer, top - 0.12, landing + RISER)), board)
    for z in np.arange(landing + 0.1, front - 0.05, 0.2).tolist():
        builder.add(cylinder(0.01, RAIL_HEIGHT, (free + side * 0.04, top, z), sides=8), iron)
    ends = (free + side * 0.015, free + side * 0.065)
    builder.add(slab((min(ends), top + RAIL_HEIGHT, landing), (max(ends), top + RAIL_HEIGHT + 0.05, front)), wood)
    start = np.array([0.0, RISE + RAIL_HEIGHT, first + GOING / 2])
    end = np.array([0.0, top + RAIL_HEIGHT, landing + GOING / 2])
    builder.add(_inclined_bar(min(ends), max(ends), start, end, 0.05), wood)
    builder.add(cylinder(0.04, top - 0.12, (free + side * 0.06, 0.0, landing + 0.06), sides=12), iron)
    flight = np.array([[inner - 0.1, 0.0, first - 0.1], [outer + 0.1, top + 1.2, front]])
    builder.blocked_volumes.append(flight)


def _inclined_bar(left: float, right: float, start: F64, end: F64, thickness: float) -> Part:
    """A bar between two x whose underside runs from ``start`` to ``end`` in y and z."""
    bar = slab((0.0, 0.0, 0.0), (1.0, thickness, 1.0))
    x = left + (right - left) * bar.positions[:, 0]
    y = bar.positions[:, 1] + start[1] + (end[1] - start[1]) * bar.positions[:, 2]
    z = start[2] + (end[2] - start[2]) * bar.positions[:, 2]
    slope = (end[1] - start[1]) / (end[2] - start[2])
    normals = bar.normals.copy()
    normals[:, 2] -= slope * normals[:, 1]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Part(np.stack([x, y, z], axis=1), normals, bar.uvs, bar.triangles)
