"""Walls with rectangular openings, floors and ceilings."""

import math
from dataclasses import dataclass, replace

import numpy as np

from app.arrays import F64
from app.scene import Material
from export.dataset.scenes.generated_scene import GeneratedSceneBuilder, Rng
from export.dataset.scenes.parts import Part, slab

THICKNESS = 0.15  # metres


@dataclass(frozen=True)
class Opening:
    """A hole in a wall: metres along the wall from its start, and above the floor."""

    left: float
    right: float
    bottom: float
    top: float


@dataclass(frozen=True, eq=False)
class Wall:
    """An upright wall on the outer side of the line from ``start`` to ``end``, each (x, z), shape (2,).

    The inside is to the left of the line, seen from above with x to the right and z up. The lines around a room
    therefore run counterclockwise in that view.
    """

    start: F64
    end: F64
    height: float
    openings: tuple[Opening, ...] = ()

    @property
    def length(self) -> float:
        return float(np.linalg.norm(self.end - self.start))

    @property
    def along(self) -> F64:
        """Unit vector, shape (3,)."""
        x, z = (self.end - self.start) / self.length
        return np.array([x, 0.0, z])

    @property
    def inward(self) -> F64:
        """Unit vector, shape (3,)."""
        x, _, z = self.along
        return np.array([-z, 0.0, x])

    @property
    def inward_azimuth(self) -> float:
        """Direction of ``inward``, radians from -z to x."""
        return math.atan2(self.inward[0], -self.inward[2])

    def point(self, along: float, up: float, depth: float = 0.0) -> F64:
        """The point at these distances along the wall, above the floor, and into the wall."""
        return np.array([self.start[0], up, self.start[1]]) + along * self.along - depth * self.inward

    def parts(self) -> list[Part]:
        """Boxes around the openings, which must not overlap."""
        parts: list[Part] = []
        x = 0.0  # the corner at the start belongs to the previous wall
        for o in sorted(self.openings, key=lambda o: o.left):
            parts += [self._part(x, o.left, 0.0, self.height), self._part(o.left, o.right, o.top, self.height)]
            if o.bottom > 0:
                parts.append(self._part(o.left, o.right, 0.0, o.bottom))
            x = o.right
        return [*parts, self._part(x, self.length + THICKNESS, 0.0, self.height)]

    def _part(self, left: float, right: float, bottom: float, top: float) -> Part:
        frame = np.eye(4)  # right-handed, so its x points from the end to the start
        frame[:3] = np.stack([-self.along, (0.0, 1.0, 0.0), -self.inward, self.point(0.0, 0.0)], axis=1)
        return slab((-right, bottom, 0.0), (-left, top, THICKNESS)).transformed(frame)


def rectangle(width: float, depth: float, height: float) -> list[Wall]:
    """Four walls around the origin; the inside is ``width`` × ``depth``."""
    x, z = width / 2, depth / 2
    corners = [np.array(c) for c in ((-x, -z), (x, -z), (x, z), (-x, z))]
    return [Wall(corners[k], corners[(k + 1) % 4], height) for k in range(4)]


def with_openings(rng: Rng, wall: Wall, count: int) -> Wall:
    """The wall with up to ``count`` windows and doors."""
    openings: list[Opening] = []
    span = wall.length / max(count, 1)
    for k in range(count):
        width = rng.uniform(0.6, 2.2)
        if span < width + 0.6:
            continue
        left = k * span + rng.uniform(0.3, span - width - 0.3)
        if rng.random() < 0.3:
            openings.append(Opening(left, left + min(width, 1.2), 0.0, min(2.1, wall.height - 0.1)))
        else:
            bottom = rng.uniform(0.3, 1.2)
            top = min(bottom + rng.uniform(0.5, 1.8), wall.height - 0.1)
            openings.append(Opening(left, left + width, bottom, top))
    return replace(wall, openings=tuple(openings))


def add_walls(builder: GeneratedSceneBuilder, walls: list[Wall], materials: list[Material]) -> None:
    for wall, material in zip(walls, materials, strict=True):
        for part in wall.parts():
            builder.add(part, material)


def add_floor(builder: GeneratedSceneBuilder, width: float, depth: float, material: Material) -> None:
    """A floor with its top at y = 0 that reaches below the walls of ``rectangle``."""
    add_ceiling(builder, width, depth, -THICKNESS, material)


def add_ceiling(builder: GeneratedSceneBuilder, width: float, depth: float, height: float, material: Material) -> None:
    """A ceiling with its bottom at ``height`` that lies on the walls of ``rectangle``."""
    x, z = width / 2 + THICKNESS, depth / 2 + THICKNESS
    builder.add(slab((-x, height, -z), (x, height + THICKNESS, z)), material)
