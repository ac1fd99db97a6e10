"""What rooms, corridors and halls share: furniture on free ground, and lamps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from export.dataset.scenes import lights
from export.dataset.scenes.assembly import Assembly, Piece
from export.dataset.scenes.generated_scene import Rng
from export.dataset.scenes.materials import glowing
from export.dataset.scenes.parts import block, cylinder, joined, sphere, turned

F64 = NDArray[np.float64]

MOVING = 0.15  # share of things that drift


def furnish(rng: Rng, assembly: Assembly, width: float, depth: float, kind: Callable[[Rng], list[Piece]],
            per_area: float, centre: tuple[float, float] = (0.0, 0.0)) -> None:
    """Put things where none stands yet, mostly along the walls of a rectangle.

    Parameters
    ----------
    per_area : float
        Things per square metre that are tried; what finds no place is left out.
    """
    for _ in range(min(int(per_area * width * depth) + 1, 24)):
        pieces = kind(rng)
        angle = rng.integers(4) * np.pi / 2 + (rng.uniform(-0.4, 0.4) if rng.random() < 0.3 else 0.0)
        box = joined([part for part, _ in pieces]).moved(turned(angle, (0.0, 0.0, 0.0))).box
        low = np.array([-width / 2, -depth / 2]) - box[0, [0, 2]] + 0.03
        high = np.array([width / 2, depth / 2]) - box[1, [0, 2]] - 0.03
        if (low >= high).any():
            continue
        x, z = rng.uniform(low, high)
        if rng.random() < 0.6:  # against a wall
            if rng.random() < 0.5:
                x = low[0] if rng.random() < 0.5 else high[0]
            else:
                z = low[1] if rng.random() < 0.5 else high[1]
        place = (x + centre[0], 0.0, z + centre[1])
        if not _overlaps(box + np.asarray(place), assembly.taken):
            assembly.put(pieces, angle, place, moves=rng.random() < MOVING)


def hang_lamps(rng: Rng, assembly: Assembly, box: F64, count: int) -> None:
    """Lamps of any kind in the ``box``, shape (2, 3): lights below its top, and glowing things."""
    (x0, y0, z0), (x1, y1, z1) = box
    for _ in range(count):
        at = np.array([rng.uniform(x0 + 0.3, x1 - 0.3), y0 + (y1 - y0) * rng.uniform(0.45, 0.92),
                       rng.uniform(z0 + 0.3, z1 - 0.3)])
        watts = 1.2 * ((y1 - y0) / 2.5) ** 2
        kind = rng.choice(3, p=(0.55, 0.25, 0.2))
        if kind == 0:
            assembly.lights.append(lights.lamp(rng, at, watts))
        elif kind == 1:
            assembly.lights.append(lights.panel(rng, at * (1, 0, 1) + (0, y1 - rng.uniform(0.02, 0.5), 0), 2 * watts))
        else:
            _shining_thing(rng, assembly, at, watts)


def _shining_thing(rng: Rng, assembly: Assembly, at: F64, watts: float) -> None:
    """A glowing ball, tube or panel; its whole surface sends the light."""
    size, kind = rng.uniform(0.08, 0.3), rng.integers(3)
    if kind == 0:
        part, area = sphere(size, rows=8), 4 * np.pi * size**2
    elif kind == 1:
        part, area = cylinder(0.5 * size, 2 * size), 2 * np.pi * size**2
    else:
        part, area = block((4 * size, 0.04, size)), 8 * size**2
    radiance = lights.strength(rng, 4 * watts / area)
    x, y, z = at.tolist()
    assembly.put([(part, glowing(radiance))], rng.uniform(0, np.pi), (x, y, z))


def _overlaps(box: F64, taken: list[F64]) -> bool:
    return any(bool(((box[0] < other[1]) & (box[1] > other[0])).all()) for other in taken)
