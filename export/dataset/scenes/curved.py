"""Things without flat faces, standing on y = 0 at the origin: bowls, bottles, curtains, plants, lamps with shades."""

from collections.abc import Callable

import numpy as np

from app.arrays import F64
from app.math3d import unit_rows
from app.simple_meshes import grid_triangles
from export.dataset.scenes import lights
from export.dataset.scenes.generated_scene import Pieces, Rng
from export.dataset.scenes.materials import emissive_material, furniture_material
from export.dataset.scenes.parts import Part, block, sphere

SIDES = 20  # around what is turned
KNOTS = 6   # of a turned profile


def sheet(points: F64, closed: bool = False) -> Part:
    """A smooth surface through a grid of points, shape (R, C, 3), that faces as ``grid_triangles`` do.

    Parameters
    ----------
    closed : bool
        Whether the last column is the first one again.
    """
    ring = points if not closed else np.concatenate([points[:, -2:-1], points, points[:, 1:2]], axis=1)
    down, along = (step[:, 1:-1] if closed else step for step in np.gradient(ring, axis=(0, 1)))
    lengths = [np.linalg.norm(step, axis=-1).cumsum(axis) for axis, step in enumerate((down, along))]
    return Part(points.reshape(-1, 3), unit_rows(np.cross(down, along).reshape(-1, 3)),
                np.stack([lengths[1], -lengths[0]], axis=-1).reshape(-1, 2), grid_triangles(*points.shape[:2]))


def turned(radii: F64, heights: F64, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Part:
    """A profile, ``radii`` and ``heights`` of shape (K,), turned about the vertical axis through ``at``."""
    phi = np.linspace(0, 2 * np.pi, SIDES + 1)
    ring = np.stack([np.sin(phi), np.zeros_like(phi), np.cos(phi)], axis=-1)
    upwards = np.asarray(at) + np.maximum(radii, 1e-3)[:, None, None] * ring + heights[:, None, None] * (0, 1, 0)
    return sheet(upwards[::-1], closed=True)


def tube(points: F64, radius: float, aside: tuple[float, float, float], sides: int = 8) -> Part:
    """A round bar along points, shape (K, 3), of which no stretch has the direction ``aside``."""
    forward = unit_rows(np.gradient(points, axis=0))
    across = unit_rows(np.cross(forward, aside))
    phi = np.linspace(0, 2 * np.pi, sides + 1)[:, None]
    ring = np.cos(phi) * across[:, None] - np.sin(phi) * np.cross(forward, across)[:, None]
    return sheet(points[:, None] + radius * ring, closed=True)


def bottle(rng: Rng) -> Pieces:
    """A turned vessel, closed at the bottom."""
    height = float(rng.uniform(0.15, 0.5))
    knots = height * rng.uniform(0.06, 0.28, KNOTS)
    share = np.linspace(0, 1, 4 * KNOTS)
    radii = np.interp(share, np.linspace(0, 1, KNOTS), knots)
    smooth = np.convolve(np.pad(radii, 2, mode="edge"), np.ones(5) / 5, mode="valid")
    return [(turned(np.append(0.0, smooth), height * np.append(0.0, share)), furniture_material(rng))]


def bowl(rng: Rng) -> Pieces:
    """A deep plate with fruit in it."""
    size = float(rng.uniform(0.1, 0.22))
    share = np.linspace(0, 1, 9)
    pieces: Pieces = [(turned(size * share, size * rng.uniform(0.3, 0.9) * share**2), furniture_material(rng))]
    for _ in range(rng.integers(0, 6)):
        radius, angle, out = 0.3 * size, rng.uniform(0, 2 * np.pi), 0.5 * size * rng.random()
        at = (out * np.cos(angle), radius + 0.2 * size, out * np.sin(angle))
        pieces.append((sphere(radius, at, rows=7), furniture_material(rng)))
    return pieces


def curtain(rng: Rng) -> Pieces:
    """Cloth in folds."""
    width, height = rng.uniform(0.4, 1.5), rng.uniform(0.8, 2.1)
    columns = int(24 * width) + 8
    u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, 5))
    folds = np.sin(2 * np.pi * width / rng.uniform(0.12, 0.3) * u + rng.uniform(0, 1) * v)
    points = np.stack([width * (u - 0.5), height * (1 - v), rng.uniform(0.02, 0.08) * (0.4 + 0.6 * v) * folds], axis=-1)
    return [(sheet(points), furniture_material(rng))]


def leaves(rng: Rng) -> Pieces:
    """A pot with long bent leaves."""
    size = float(rng.uniform(0.25, 0.7))
    pot = turned(0.3 * size * np.array([0.0, 0.6, 0.8, 1.0, 0.9]), 0.5 * size * np.array([0.0, 0.0, 0.5, 1.0, 1.0]))
    along, across = np.meshgrid(np.linspace(0, 1, 7), (-1.0, 0.0, 1.0), indexing="ij")
    parts = []
    for _ in range(rng.integers(8, 30)):
        angle, lean, length = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 1.3), size * rng.uniform(0.5, 1.0)
        out = length * along * np.sin(lean * along)
        side = 0.12 * size * np.sin(np.pi * np.clip(along, 0.05, 0.97)) * across
        up = 0.45 * size + length * along * np.cos(lean * along) - 0.3 * np.abs(side)
        parts.append(sheet(np.stack([out * np.cos(angle) - side * np.sin(angle), up,
                                     out * np.sin(angle) + side * np.cos(angle)], axis=-1)))
    leaf = furniture_material(rng)
    return [(pot, furniture_material(rng)), *((part, leaf) for part in parts)]


def bent_chair(rng: Rng) -> Pieces:
    """A round seat on splayed legs of bent bars, with a hoop for its back."""
    wood, height, radius = furniture_material(rng), float(rng.uniform(0.4, 0.5)), float(rng.uniform(0.17, 0.25))
    seat = turned(radius * np.array([0.0, 0.9, 1.0, 0.9, 0.0]), height + np.array([-0.02, -0.02, 0.0, 0.02, 0.015]))
    pieces: Pieces = [(seat, furniture_material(rng))]
    t = np.linspace(0, 1, 7)
    for x, z in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        out = 0.7 * radius * (1 + rng.uniform(0.2, 0.5) * t**2)
        pieces.append((tube(np.stack([x * out, height * (1 - t), z * out], axis=-1), 0.014, (1.0, 0.0, 0.0)), wood))
    angle = np.linspace(0.02, np.pi - 0.02, 13)
    rise = float(rng.uniform(0.3, 0.5))
    arch = np.sin(angle)
    hoop = np.stack([0.85 * radius * np.cos(angle), height + rise * arch**0.7, -0.8 * radius - 0.15 * arch], axis=-1)
    return [*pieces, (tube(hoop, 0.012, (0.0, 0.0, 1.0)), wood)]


def cushion(rng: Rng) -> Pieces:
    """A stuffed square."""
    size, thick = float(rng.uniform(0.2, 0.6)), float(rng.uniform(0.08, 0.2))
    u, v = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9))
    bulge = thick * ((1 - u**4) * (1 - v**4)) ** 0.5
    cloth = furniture_material(rng)
    top, bottom = (np.stack([size * u, thick + side * bulge, size * v], axis=-1) / 2 for side in (1, -1))
    return [(sheet(top), cloth), (sheet(bottom[::-1]), cloth)]


def shaded_lamp(rng: Rng) -> Pieces:
    """A bulb within an open shade on a turned foot."""
    height, size = float(rng.uniform(0.25, 1.5)), float(rng.uniform(0.1, 0.22))
    share = np.linspace(0, 1, 12)
    foot = turned(0.02 + 0.5 * size * np.exp(-6 * share) + 0.01 * np.cos(12 * share), height * share)
    shade = turned(size * np.array([1.0, 0.8, 0.6]), height + size * np.array([-0.2, 0.4, 1.0]))
    bulb = sphere(0.25 * size, (0.0, height + 0.35 * size, 0.0), rows=7)
    return [(foot, furniture_material(rng)), (shade, furniture_material(rng)),
            (bulb, emissive_material(lights.random_light_color(rng, 25.0)))]


def rail(rng: Rng) -> Pieces:
    """Turned posts under a bar."""
    count, gap, height = int(rng.integers(3, 9)), float(rng.uniform(0.1, 0.2)), float(rng.uniform(0.4, 0.9))
    share = np.linspace(0, 1, 14)
    radii = 0.02 + 0.015 * np.sin(rng.uniform(6, 14) * share) ** 2
    wood, end = furniture_material(rng), count * gap / 2
    posts = [(turned(radii, height * share, ((k + 0.5) * gap - end, 0.0, 0.0)), wood) for k in range(count)]
    return [*posts, (block((2 * end, 0.05, 0.07), (0.0, height, 0.0)), wood)]


STANDING: tuple[Callable[[Rng], Pieces], ...] = (curtain, leaves, bent_chair, shaded_lamp, rail)
SMALL: tuple[Callable[[Rng], Pieces], ...] = (bottle, bowl, cushion, leaves)
