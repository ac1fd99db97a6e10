"""A room lit by a large emissive pane behind window bars and a blind of slats."""

import math

import numpy as np

from app.math3d import affine_matrix, axis_angle_matrix
from export.dataset.scenes.generated_scene import GeneratedScene, GeneratedSceneBuilder, Rng
from export.dataset.scenes.parts import block, cylinder, slab
from export.dataset.scenes.walls import THICKNESS, Opening, Wall, rectangle
from export.validation.scenes.interior import (
    add_shell,
    dining_table,
    emissive_pane,
    furnish_statically,
    lacquer,
    metal,
    reserve_camera,
)

MIN_WINDOW_WIDTH = 2.1  # metres, like all lengths here
BAR_RADIUS, BAR_SPACING = 0.008, 0.12
SLAT_WIDTH, SLAT_THICKNESS, SLAT_SPACING = 0.05, 0.002, 0.045
FRAME = 0.05
PANE_DISTANCE = 0.4     # behind the wall
PANE_MARGIN = 0.25      # beyond the window's edges, so that the room never sees the edge of the pane straight ahead
RADIANCE = 11.0         # W/(sr m²), mean


def barred_window(rng: Rng) -> GeneratedScene:
    """A furnished room with one wide window."""
    builder = GeneratedSceneBuilder(rng)
    width, depth, height = (float(x) for x in rng.uniform((3.4, 3.8, 2.5), (5.0, 5.5, 2.9)))
    wide = float(rng.uniform(MIN_WINDOW_WIDTH, min(2.8, width - 0.8)))
    sill = float(rng.uniform(0.7, 0.95))
    window = Opening((width - wide) / 2, (width + wide) / 2, sill, sill + float(rng.uniform(1.25, 1.5)))
    walls = rectangle(width, depth, height)
    outer = Wall(walls[0].start, walls[0].end, height, (window,))  # at the smallest z
    add_shell(rng, builder, [outer, *walls[1:]], width, depth)
    left, right, inner = window.left - width / 2, window.right - width / 2, -depth / 2
    _add_frame_and_bars(rng, builder, (left, right), window, inner - THICKNESS)
    _add_blind(rng, builder, (left, right), window, inner)
    m = PANE_MARGIN
    builder.add(*emissive_pane(rng, RADIANCE, (left - m, window.bottom - m, inner - THICKNESS - PANE_DISTANCE),
                               (wide + 2 * m, 0, 0), (0, window.top - window.bottom + 2 * m, 0)))
    table_at = (float(rng.uniform(-0.6, 0.6)), 0.0, inner + float(rng.uniform(1.2, 1.6)))
    builder.add_object(dining_table(rng), float(rng.uniform(-0.2, 0.2)), table_at)
    camera = reserve_camera(builder, (width / 2 - 0.4, 1.5, depth / 2 - 0.4), (-0.3, 1.0, inner))
    furnish_statically(rng, builder, width, depth - 0.4, 0.4, (0.0, 0.2))
    x, z = width / 2 - 0.3, depth / 2 - 0.3
    return builder.build("barred_window", [[[-x, 0.8, inner + 0.9], [x, 1.9, z]]], camera)


def _add_frame_and_bars(rng: Rng, builder: GeneratedSceneBuilder, span: tuple[float, float], window: Opening,
                        outside: float) -> None:
    """Add the frame in the middle of the wall, and the bars at its outer face at z = ``outside``."""
    paint, iron = lacquer(rng), metal(rng)
    left, right = span
    z0, z1 = outside + 0.05, outside + 0.11
    for low, high in (((left, window.bottom), (left + FRAME, window.top)),
                      ((right - FRAME, window.bottom), (right, window.top)),
                      ((left + FRAME, window.bottom), (right - FRAME, window.bottom + FRAME)),
                      ((left + FRAME, window.top - FRAME), (right - FRAME, window.top))):
        builder.add(slab((*low, z0), (*high, z1)), paint)
    mullion = (left + right) / 2
    builder.add(slab((mullion - 0.03, window.bottom + FRAME, z0), (mullion + 0.03, window.top - FRAME, z1)), paint)
    count = round((right - left) / BAR_SPACING)
    for x in np.linspace(left, right, count + 1)[1:-1].tolist():
        builder.add(cylinder(BAR_RADIUS, window.top - window.bottom, (x, window.bottom, outside + 0.02), sides=8), iron)
    for y in np.linspace(window.bottom, window.top, 4)[1:-1].tolist():
        builder.add(slab((left, y - 0.012, outside + 0.029), (right, y + 0.012, outside + 0.035)), iron)


def _add_blind(rng: Rng, builder: GeneratedSceneBuilder, span: tuple[float, float], window: Opening,
               inner: float) -> None:
    """Add tilted slats inside the room that cover the upper part of the window, their box, cords, and a sill."""
    slat, box = lacquer(rng), lacquer(rng)
    left, right = span[0] - 0.04, span[1] + 0.04
    z, top = inner + 0.05, window.top + 0.08
    builder.add(slab((left, top - 0.05, inner), (right, top, inner + 0.08)), box)
    tilt = math.radians(float(rng.uniform(20, 50)))
    covered = float(rng.uniform(0.55, 0.9)) * (window.top - window.bottom)
    ys = np.arange(top - 0.05 - SLAT_SPACING, window.top - covered, -SLAT_SPACING).tolist()
    shape = block((right - left - 0.01, SLAT_THICKNESS, SLAT_WIDTH))
    for y in ys:
        turn = affine_matrix(axis_angle_matrix(np.array([tilt, 0.0, 0.0])), ((left + right) / 2, y, z))
        builder.add(shape.transformed(turn), slat)
    bottom = ys[-1] - SLAT_SPACING
    builder.add(slab((left, bottom - 0.02, z - 0.02), (right, bottom, z + 0.02)), box)
    for share in (0.15, 0.85):
        x = left + share * (right - left)
        builder.add(slab((x, bottom, z + 0.03), (x + 0.004, top - 0.05, z + 0.034)), slat)
    builder.add(slab((left - 0.04, window.bottom - 0.03, inner), (right + 0.04, window.bottom, inner + 0.16)), box)
