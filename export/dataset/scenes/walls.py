"""Walls with rectangular openings, and what they stand around."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.scene import Material
from export.dataset.scenes.assembly import Assembly
from export.dataset.scenes.generated_scene import Rng
from export.dataset.scenes.parts import Part, slab

F64 = NDArray[np.float64]

THICKNESS = 0.15


@dataclass(frozen=True)
class Opening:
    """A hole in a wall, in metres along the wall from its start, and up from the floor."""

    left: float
    right: float
    bottom: float
    top: float


@dataclass(frozen=True, eq=False)
class Wall:
    """An upright wall that stands outside the line from ``start`` to ``end``, shape (2,) each: x and z.

    The inside lies to the left of the line seen from above with x to the right and z up: lines around a room run
    so that the room is at their left.
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

    def point(self, along: float, up: float, depth: float = 0.0) -> F64:
        """The point so far along the wall, above the floor, and into the wall."""
        return np.array([self.start[0], up, self.start[1]]) + along * self.along - depth * self.inward

    def parts(self) -> list[Part]:
        """Blocks around the openings, which must not overlap."""
        parts: list[Part] = []
        x = 0.0  # the wall before covers the corner
        for o in sorted(self.openings, key=lambda o: o.left):
            parts += [self._piece(x, o.left, 0.0, self.height), self._piece(o.left, o.right, o.top, self.height)]
            if o.bottom > 0:
                parts.append(self._piece(o.left, o.right, 0.0, o.bottom))
            x = o.right
        return [*parts, self._piece(x, self.length + THICKNESS, 0.0, self.height)]

    def _piece(self, left: float, right: float, bottom: float, top: float) -> Part:
        frame = np.eye(4)
        frame[:3, 0], frame[:3, 2] = self.along, -self.inward
        frame[:3, 1] = (0.0, 1.0, 0.0)
        frame[:3, 3] = self.point(0.0, 0.0)
        if np.linalg.det(frame[:3, :3]) < 0:  # keep triangles facing outwards
            frame[:3, 0], left, right = -frame[:3, 0], -right, -left
        return slab((left, bottom, 0.0), (right, top, THICKNESS)).moved(frame)


def rectangle(width: float, depth: float, height: float) -> list[Wall]:
    """Four walls around the origin; the inside is ``width`` × ``depth``."""
    x, z = width / 2, depth / 2
    corners = [np.array(c) for c in ((-x, -z), (x, -z), (x, z), (-x, z))]
    return [Wall(corners[k], corners[(k + 1) % 4], height) for k in range(4)]


def with_openings(rng: Rng, wall: Wall, count: int, doors: bool = True) -> Wall:
    """The wall with up to ``count`` windows and doors."""
    openings: list[Opening] = []
    span = wall.length / max(count, 1)
    for k in range(count):
        width = rng.uniform(0.6, 2.2)
        if span < width + 0.6:
            continue
        left = k * span + rng.uniform(0.3, span - width - 0.3)
        if doors and rng.random() < 0.3:
            openings.append(Opening(left, left + min(width, 1.2), 0.0, min(2.1, wall.height - 0.1)))
        else:
            bottom = rng.uniform(0.3, 1.2)
            top = min(bottom + rng.uniform(0.5, 1.8), wall.height - 0.1)
            openings.append(Opening(left, left + width, bottom, top))
    return Wall(wall.start, wall.end, wall.height, tuple(openings))


def build(assembly: Assembly, walls: list[Wall], paint: list[Material]) -> None:
    """Add each wall in its own paint."""
    for wall, material in zip(walls, paint, strict=True):
        for part in wall.parts():
            assembly.add(part, material)
