"""Furniture made of boxes, cylinders and spheres in metres, standing on y = 0 at the origin."""

from collections.abc import Callable

from app.scene import Material
from export.dataset.scenes.generated_scene import Pieces, Rng
from export.dataset.scenes.materials import furniture_material
from export.dataset.scenes.parts import block, cylinder, sphere


def table(rng: Rng) -> Pieces:
    """A top on four legs or on a round foot, with small objects on it."""
    wood = furniture_material(rng)
    width, depth, height = rng.uniform(0.6, 2.0), rng.uniform(0.5, 1.0), rng.uniform(0.4, 0.8)
    if rng.random() < 0.3:
        return [(cylinder(width / 2, 0.04, (0, height, 0)), wood), (cylinder(0.05, height), furniture_material(rng)),
                (cylinder(width / 4, 0.03), wood), *_clutter(rng, width / 2, width / 2, height + 0.04)]
    return [(block((width, 0.05, depth), (0, height, 0)), wood), *_legs(width, depth, height, furniture_material(rng)),
            *_clutter(rng, 0.8 * width, 0.8 * depth, height + 0.05)]


def chair(rng: Rng) -> Pieces:
    """A seat on four legs, usually with a back."""
    wood, side, height = furniture_material(rng), rng.uniform(0.38, 0.5), rng.uniform(0.4, 0.5)
    pieces: Pieces = [(block((side, 0.05, side), (0, height, 0)), wood), *_legs(side, side, height, wood)]
    if rng.random() < 0.85:
        pieces.append((block((side, rng.uniform(0.3, 0.6), 0.04), (0, height + 0.05, -side / 2 + 0.02)), wood))
    return pieces


def sofa(rng: Rng) -> Pieces:
    """Seat, back, arms and cushions."""
    cloth = furniture_material(rng)
    width, depth, height = rng.uniform(0.9, 2.4), rng.uniform(0.8, 1.0), rng.uniform(0.38, 0.48)
    pieces: Pieces = [(block((width, height, depth)), cloth),
                      (block((width, 0.45, 0.2), (0, height, -depth / 2 + 0.1)), cloth)]
    pieces += [(block((0.16, height + 0.2, depth), (s * (width / 2 + 0.08), 0, 0)), cloth) for s in (-1, 1)]
    for _ in range(rng.integers(0, 3)):
        at = (rng.uniform(-0.35, 0.35) * width, height, -0.1)
        pieces.append((block((0.4, 0.35, 0.12), at), furniture_material(rng)))
    return pieces


def shelf(rng: Rng) -> Pieces:
    """Boards between two sides, with books and boxes."""
    wood, width, depth = furniture_material(rng), rng.uniform(0.6, 1.6), rng.uniform(0.25, 0.4)
    levels = int(rng.integers(2, 6))
    height = levels * rng.uniform(0.3, 0.45)
    pieces: Pieces = [(block((0.03, height, depth), (s * width / 2, 0, 0)), wood) for s in (-1, 1)]
    pieces += [(block((width, 0.03, depth), (0, k * height / levels, 0)), wood) for k in range(levels + 1)]
    if rng.random() < 0.7:
        pieces.append((block((width, height, 0.02), (0, 0, -depth / 2)), wood))
    books = [furniture_material(rng) for _ in range(3)]
    for k in range(levels):
        x = -width / 2 + 0.05
        while x < width / 2 - 0.1 and rng.random() < 0.8:
            thick = rng.uniform(0.04, 0.2)
            tall = rng.uniform(0.5, 0.9) * (height / levels - 0.03)
            pieces.append((block((thick, tall, 0.8 * depth), (x + thick / 2, k * height / levels + 0.03, 0)),
                           books[rng.integers(3)]))
            x += thick + rng.uniform(0.0, 0.15)
    return pieces


def bed(rng: Rng) -> Pieces:
    """Frame, mattress, pillow and headboard."""
    wood, sheet, width = furniture_material(rng), furniture_material(rng), rng.uniform(0.9, 1.8)
    return [(block((width, 0.3, 2.0)), wood), (block((width - 0.06, 0.2, 1.94), (0, 0.3, 0)), sheet),
            (block((0.5, 0.1, 0.35), (0, 0.5, -0.75)), furniture_material(rng)),
            (block((width, 0.9, 0.06), (0, 0, -1.0)), wood)]


def boxes(rng: Rng) -> Pieces:
    """A stack of crates, each smaller than the one below."""
    pieces: Pieces = []
    side, y = rng.uniform(0.3, 0.9), 0.0
    for _ in range(rng.integers(1, 4)):
        height = side * rng.uniform(0.5, 1.2)
        pieces.append((block((side, height, side * rng.uniform(0.7, 1.0)), (0, y, 0)), furniture_material(rng)))
        side, y = side * rng.uniform(0.5, 0.9), y + height
    return pieces


def plant(rng: Rng) -> Pieces:
    """A pot with a sphere of leaves on a stem."""
    pot, leaf = furniture_material(rng), furniture_material(rng)
    height, size = rng.uniform(0.3, 1.0), rng.uniform(0.2, 0.45)
    return [(cylinder(0.18, 0.3), pot), (cylinder(0.03, height, (0, 0.3, 0)), pot),
            (sphere(size, (0, 0.3 + height + 0.6 * size, 0), rows=8), leaf)]


def vase(rng: Rng) -> Pieces:
    """A sphere or a cylinder on the floor."""
    size = rng.uniform(0.15, 0.5)
    part = sphere(size, (0, size, 0)) if rng.random() < 0.5 else cylinder(size, rng.uniform(0.3, 1.5))
    return [(part, furniture_material(rng))]


KINDS: tuple[Callable[[Rng], Pieces], ...] = (table, chair, chair, sofa, shelf, shelf, bed, boxes, plant, vase)


def random_furniture(rng: Rng) -> Pieces:
    """Furniture of any kind."""
    return KINDS[rng.integers(len(KINDS))](rng)


def _legs(width: float, depth: float, height: float, wood: Material) -> Pieces:
    x, z = width / 2 - 0.04, depth / 2 - 0.04
    return [(block((0.05, height, 0.05), (i * x, 0, j * z)), wood) for i in (-1, 1) for j in (-1, 1)]


def _clutter(rng: Rng, width: float, depth: float, height: float) -> Pieces:
    """Small objects on a table top."""
    pieces: Pieces = []
    for _ in range(rng.integers(0, 4)):
        at = (rng.uniform(-0.5, 0.5) * width, height, rng.uniform(-0.5, 0.5) * depth)
        size = rng.uniform(0.05, 0.16)
        kind = rng.integers(3)
        if kind == 0:
            part = block((2 * size, rng.uniform(0.03, 0.4), 2 * size), at)
        elif kind == 1:
            part = cylinder(size, rng.uniform(0.05, 0.35), at)
        else:
            part = sphere(size, (at[0], at[1] + size, at[2]), rows=8)
        pieces.append((part, furniture_material(rng)))
    return pieces
