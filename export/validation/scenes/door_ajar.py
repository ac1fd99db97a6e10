"""Two rooms, of which only the farther one is lit: light reaches the nearer one past a door that stands ajar."""

import math
from dataclasses import dataclass

import numpy as np

from app.errors import SettingsError
from app.math3d import translation
from app.scene import Material
from app.simple_meshes import rotation_about_y
from export.dataset.scenes.generated_scene import GeneratedScene, GeneratedSceneBuilder, Rng
from export.dataset.scenes.parts import Part, cylinder, slab
from export.dataset.scenes.walls import THICKNESS, rectangle
from export.validation.scenes.interior import (
    add_shell,
    dining_table,
    emissive_pane,
    furnish_statically,
    lacquer,
    metal,
    partition,
    reserve_camera,
)

MIN_ANGLE_DEG, MAX_ANGLE_DEG = 1.0, 60.0
LEAF_THICKNESS = 0.04  # metres, like all lengths here
GAP, GAP_BELOW = 0.003, 0.008
CASING = (0.07, 0.015)      # width and thickness of the boards around the doorway
STOP = (0.012, 0.03)        # how far the strip that the leaf closes against stands out, and its depth
HANDLE_HEIGHT = 1.02
RADIANCE = 50.0             # W/(sr m²), mean


@dataclass(frozen=True)
class _Doorway:
    """A doorway in the plane z = ``z``, seen from +z; ``side`` is 1 if the hinges are on the left, -1 on the right."""

    left: float
    width: float
    height: float
    z: float
    side: int

    def at(self, low: tuple[float, float, float], high: tuple[float, float, float]) -> Part:
        """The box between two corners whose x is measured from the hinges and whose z from the wall's front."""
        hinge = self.left if self.side > 0 else self.left + self.width
        xs = sorted((hinge + self.side * low[0], hinge + self.side * high[0]))
        return slab((xs[0], low[1], self.z + low[2]), (xs[1], high[1], self.z + high[2]))


def door_ajar(rng: Rng, angle_deg: float) -> GeneratedScene:
    """A dark room, whose door stands open by ``angle_deg``, and a room lit by a large emissive panel.

    The panel hangs on the side of the hinges, so that what stands behind the leaf never sees it.

    Raises
    ------
    SettingsError
        When the angle is not in [1, 60].
    """
    if not MIN_ANGLE_DEG <= angle_deg <= MAX_ANGLE_DEG:
        raise SettingsError(f"door open by {angle_deg:g} degrees", "angle_deg",
                            f"expected {MIN_ANGLE_DEG:g} to {MAX_ANGLE_DEG:g}")
    builder = GeneratedSceneBuilder(rng)
    width, height = float(rng.uniform(3.6, 4.8)), float(rng.uniform(2.45, 2.8))
    dark_depth, lit_depth = (float(d) for d in rng.uniform((3.6, 3.0), (4.8, 4.2)))
    front, back = (dark_depth + lit_depth) / 2, -(dark_depth + lit_depth) / 2
    side = 1 if rng.random() < 0.5 else -1
    door_width, door_height = float(rng.uniform(0.82, 0.94)), float(rng.uniform(1.98, 2.08))
    middle = float(rng.uniform(-0.3, 0.3))
    door = _Doorway(middle - door_width / 2, door_width, door_height, front - dark_depth, side)
    wall = partition(width, door.z, height, door.left, door.left + door_width, door_height)
    add_shell(rng, builder, [*rectangle(width, front - back, height), wall], width, front - back)
    _add_door(rng, builder, door, angle_deg)
    _add_panel(rng, builder, -side * width / 2, side, (back, door.z - THICKNESS), height)

    behind_leaf = -side * (width / 2 - 0.85)
    builder.add_object(dining_table(rng), float(rng.uniform(-0.1, 0.1)) + math.pi / 2,
                       (behind_leaf, 0.0, door.z + float(rng.uniform(1.2, 1.6))))
    camera = reserve_camera(builder, (side * (width / 2 - 0.4), 1.5, front - 0.4), (-side * 0.6, 0.9, door.z))
    furnish_statically(rng, builder, width, dark_depth - 0.3, 0.35, (0.0, front - dark_depth / 2 + 0.15))
    lit_middle = (back + door.z - THICKNESS) / 2
    furnish_statically(rng, builder, width - 1.0, lit_depth - 1.4, 0.2, (side * 0.5, lit_middle - 0.4))
    x = width / 2 - 0.3
    dark = [[-x, 0.9, door.z + 0.9], [x, 1.8, front - 0.3]]
    return builder.build("door_ajar", [dark], camera)


def _add_door(rng: Rng, builder: GeneratedSceneBuilder, door: _Doorway, angle_deg: float) -> None:
    """Add the leaf with its handles, the casings on both sides of the wall, and the strip that the leaf closes against.

    The leaf is hinged at the front edge of the doorway and opens to the front.
    """
    paint, brass = lacquer(rng), metal(rng)
    wide, thick = CASING
    for z in (0.0, -THICKNESS - thick):
        builder.add(door.at((-wide, 0, z), (0, door.height + wide, z + thick)), paint)
        builder.add(door.at((door.width, 0, z), (door.width + wide, door.height + wide, z + thick)), paint)
        builder.add(door.at((0, door.height, z), (door.width, door.height + wide, z + thick)), paint)
    out, deep = STOP
    rear = -LEAF_THICKNESS - 0.002
    builder.add(door.at((0, 0, rear - deep), (out, door.height, rear)), paint)
    builder.add(door.at((door.width - out, 0, rear - deep), (door.width, door.height, rear)), paint)
    builder.add(door.at((out, door.height - out, rear - deep), (door.width - out, door.height, rear)), paint)
    hinge = np.array([door.left if door.side > 0 else door.left + door.width, 0.0, door.z])
    turn = translation(hinge) @ rotation_about_y(-door.side * math.radians(angle_deg)) @ translation(-hinge)
    for part, material in _leaf(door, paint, brass):
        builder.add(part.transformed(turn), material)
    reach = door.width + 0.1
    builder.blocked_volumes.append(hinge + np.array([[-reach, 0.0, 0.0], [reach, door.height, reach]]))


def _leaf(door: _Doorway, paint: Material, brass: Material) -> list[tuple[Part, Material]]:
    """The closed leaf, two hinges and a lever on each face."""
    end = door.width - GAP
    parts = [(door.at((GAP, GAP_BELOW, -LEAF_THICKNESS), (end, door.height - GAP, 0)), paint)]
    hinge = door.left if door.side > 0 else door.left + door.width
    parts += [(cylinder(0.008, 0.1, (hinge, y, door.z + 0.008), sides=8), brass) for y in (0.25, door.height - 0.35)]
    for face, away in ((0.0, 1), (-LEAF_THICKNESS, -1)):
        for low, high in (((end - 0.085, HANDLE_HEIGHT - 0.02, 0.0), (end - 0.045, HANDLE_HEIGHT + 0.02, 0.05)),
                          ((end - 0.17, HANDLE_HEIGHT - 0.01, 0.04), (end - 0.045, HANDLE_HEIGHT + 0.01, 0.06))):
            z = sorted((face + away * low[2], face + away * high[2]))
            parts.append((door.at((low[0], low[1], z[0]), (high[0], high[1], z[1])), brass))
    return parts


def _add_panel(rng: Rng, builder: GeneratedSceneBuilder, x: float, side: int, span: tuple[float, float],
               height: float) -> None:
    """Add a panel on the wall at ``x`` between two z, which emits to ``side`` along x, and the board behind it."""
    length, tall = min(float(rng.uniform(2.0, 2.8)), span[1] - span[0] - 0.5), float(rng.uniform(1.2, 1.6))
    z, y = (span[0] + span[1] - length) / 2, float(rng.uniform(0.5, height - tall - 0.2))
    board = sorted((x, x + side * 0.03))
    builder.add(slab((board[0], y - 0.02, z - 0.02), (board[1], y + tall + 0.02, z + length + 0.02)), metal(rng))
    at = x + side * 0.035
    if side > 0:  # u × v points along x
        pane = emissive_pane(rng, RADIANCE, (at, y, z + length), (0, 0, -length), (0, tall, 0))
    else:
        pane = emissive_pane(rng, RADIANCE, (at, y, z), (0, 0, length), (0, tall, 0))
    builder.add(*pane)
