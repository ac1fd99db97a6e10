"""What indoor scenes share: furniture on free floor, and lights."""

from collections.abc import Callable

import numpy as np

from app.arrays import F64
from app.simple_meshes import rotation_about_y
from export.dataset.scenes import lights
from export.dataset.scenes.generated_scene import GeneratedSceneBuilder, Pieces, Rng
from export.dataset.scenes.materials import emissive_material
from export.dataset.scenes.parts import block, cylinder, merge, sphere

MOVING_SHARE = 0.15  # of the objects
MAX_OBJECTS = 24


def furnish(rng: Rng, builder: GeneratedSceneBuilder, width: float, depth: float, kind: Callable[[Rng], Pieces],
            per_area: float, centre: tuple[float, float] = (0.0, 0.0), moving_share: float = MOVING_SHARE) -> None:
    """Add objects that don't overlap, most of them along the walls of a rectangle.

    Parameters
    ----------
    kind : callable
        Makes a random object.
    per_area : float
        Attempts per square metre; an object that overlaps another is dropped.
    centre : tuple of float
        x and z of the rectangle's centre.
    moving_share : float
        Of the objects.
    """
    for _ in range(min(int(per_area * width * depth) + 1, MAX_OBJECTS)):
        pieces = kind(rng)
        angle = rng.integers(4) * np.pi / 2 + (rng.uniform(-0.4, 0.4) if rng.random() < 0.3 else 0.0)
        bounds = merge([part for part, _ in pieces]).transformed(rotation_about_y(angle)).bounds
        low = np.array([-width / 2, -depth / 2]) - bounds[0, [0, 2]] + 0.03
        high = np.array([width / 2, depth / 2]) - bounds[1, [0, 2]] - 0.03
        if (low >= high).any():
            continue
        x, z = rng.uniform(low, high)
        if rng.random() < 0.6:  # against a wall
            if rng.random() < 0.5:
                x = low[0] if rng.random() < 0.5 else high[0]
            else:
                z = low[1] if rng.random() < 0.5 else high[1]
        at = (x + centre[0], 0.0, z + centre[1])
        low, high = bounds + np.asarray(at)
        if not any(bool(((low < box[1]) & (high > box[0])).all()) for box in builder.blocked_volumes):
            builder.add_object(pieces, angle, at, moves=rng.random() < moving_share)


def add_local_lights(rng: Rng, builder: GeneratedSceneBuilder, box: F64, count: int) -> None:
    """Add lights of any kind or emissive objects in the upper half of the ``box``, shape (2, 3)."""
    (x0, y0, z0), (x1, y1, z1) = box
    for _ in range(count):
        at = np.array([rng.uniform(x0 + 0.3, x1 - 0.3), y0 + (y1 - y0) * rng.uniform(0.45, 0.92),
                       rng.uniform(z0 + 0.3, z1 - 0.3)])
        intensity = 1.2 * ((y1 - y0) / 2.5) ** 2
        kind = rng.choice(3, p=(0.55, 0.25, 0.2))
        if kind == 0:
            builder.lights.append(lights.local_light(rng, at, intensity))
        elif kind == 1:
            below_ceiling = at * (1, 0, 1) + (0, y1 - rng.uniform(0.02, 0.5), 0)
            builder.lights.append(lights.panel(rng, below_ceiling, 2 * intensity))
        else:
            _add_emissive_object(rng, builder, at, intensity)


def _add_emissive_object(rng: Rng, builder: GeneratedSceneBuilder, at: F64, intensity: float) -> None:
    """Add an emissive sphere, tube or panel."""
    size, kind = rng.uniform(0.08, 0.3), rng.integers(3)
    if kind == 0:
        part, area = sphere(size, rows=8), 4 * np.pi * size**2
    elif kind == 1:
        part, area = cylinder(0.5 * size, 2 * size), 2 * np.pi * size**2
    else:
        part, area = block((4 * size, 0.04, size)), 8 * size**2
    radiance = lights.random_light_color(rng, 4 * intensity / area)
    x, y, z = at.tolist()
    builder.add_object([(part, emissive_material(radiance))], rng.uniform(0, np.pi), (x, y, z))
