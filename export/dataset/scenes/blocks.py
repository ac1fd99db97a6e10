"""Block worlds: terrain and houses of textured cubes, by day and by night."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.math3d import translation
from app.scene import Material
from export.dataset.scenes import lights
from export.dataset.scenes.assembly import Assembly
from export.dataset.scenes.generated_scene import GeneratedScene, Rng
from export.dataset.scenes.materials import glowing, random_material
from export.dataset.scenes.parts import Part, block, joined, quad

Ints = NDArray[np.int64]

SIDE = 24          # cubes along the world, of a metre each
HIGHEST = 16
AIR = -1
FACES = {          # direction: corner, u and v of the unit cube's face; u × v points there
    (1, 0, 0): ((1, 0, 1), (0, 0, -1), (0, 1, 0)), (-1, 0, 0): ((0, 0, 0), (0, 0, 1), (0, 1, 0)),
    (0, 1, 0): ((0, 1, 1), (1, 0, 0), (0, 0, -1)), (0, -1, 0): ((0, 0, 0), (1, 0, 0), (0, 0, 1)),
    (0, 0, 1): ((0, 0, 1), (1, 0, 0), (0, 1, 0)), (0, 0, -1): ((1, 0, 0), (-1, 0, 0), (0, 1, 0)),
}


def blocks_by_day(rng: Rng) -> GeneratedScene:
    """Under the sun and a little sky."""
    return _world(rng, night=False)


def blocks_by_night(rng: Rng) -> GeneratedScene:
    """By lamps on posts and in houses, and now and then the moon."""
    return _world(rng, night=True)


def blocks(rng: Rng) -> GeneratedScene:
    """By day, or one in three times by night."""
    return _world(rng, night=rng.random() < 1 / 3)


def _world(rng: Rng, night: bool) -> GeneratedScene:
    assembly = Assembly(rng)
    ground = _terrain(rng)
    cubes = np.full((SIDE, HIGHEST, SIDE), AIR)
    cubes[np.arange(HIGHEST)[None, :, None] < ground[:, None, :]] = 0
    surface = np.arange(HIGHEST)[None, :, None] == ground[:, None, :] - 1
    cubes[surface] = 1
    materials = [random_material(rng, 0.3, 0.85, textured=0.8, metres=1.0) for _ in range(7)]
    rooms = [_house(rng, cubes, ground) for _ in range(rng.integers(1, 5))]
    for _ in range(rng.integers(0, 6)):
        _tree(rng, cubes, ground)
    _add_faces(assembly, cubes, materials)
    for x, y, z in (_anywhere(rng, ground) for _ in range(rng.integers(0, 4))):
        crate = [(block((0.8, 0.8, 0.8)), random_material(rng, 0.2, 0.9, textured=0.5))]
        assembly.put(crate, rng.uniform(0, np.pi), (x, y, z), moves=rng.random() < 0.6)
    if not night:
        assembly.lights.append(lights.sun(rng, lowest_deg=20.0, irradiance=12.0))
        if rng.random() < 0.5:
            assembly.lights += lights.sky(rng, 3, 3.0)
    elif rng.random() < 0.4:
        assembly.lights.append(lights.sun(rng, lowest_deg=30.0, irradiance=0.5))
    for _ in range(rng.integers(2, 5) if night else rng.integers(0, 2)):
        _post(rng, assembly, _anywhere(rng, ground))
    for room in rooms:
        if rng.random() < (0.8 if night else 0.3):
            at = np.add(room, (rng.uniform(-0.5, 0.5), 0.8, rng.uniform(-0.5, 0.5)))
            assembly.lights.append(lights.lamp(rng, at, 3.0))
    low = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij"), -1)[2:-2, 2:-2].reshape(-1, 2)
    tops = ground[low[:, 0], low[:, 1]]
    free = np.stack([np.column_stack([low[:, 0] + 0.2, tops + 1.2, low[:, 1] + 0.2]),
                     np.column_stack([low[:, 0] + 0.8, tops + 3.5, low[:, 1] + 0.8])], axis=1)
    outside = np.array([all(cubes[x, y:y + 4, z] == AIR) for (x, z), y in zip(low, tops, strict=True)])
    inside = [[(x - 0.8, y + 0.1, z - 0.8), (x + 0.8, y + 0.9, z + 0.8)] for x, y, z in rooms]
    return assembly.place("blocks", [*free[outside], *inside * 15])


def _terrain(rng: Rng) -> Ints:
    """Rolling ground, heights in cubes, with a hollow or a mound."""
    x, z = np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij")
    height = np.full((SIDE, SIDE), 3.0)
    for _ in range(4):
        kx, kz = rng.uniform(-0.45, 0.45, 2)
        height += rng.uniform(0.2, 1.0) * np.sin(kx * x + kz * z + rng.uniform(0, 2 * np.pi))
    return np.clip(np.round(height), 1, 7).astype(np.int64)


def _house(rng: Rng, cubes: Ints, ground: Ints) -> tuple[float, float, float]:
    """Walls, a roof, a door and windows on levelled ground; the middle of its room, at a standing eye's knees."""
    width, depth, height = rng.integers(5, 9), rng.integers(5, 9), rng.integers(3, 5)
    i, j = rng.integers(1, SIDE - width - 1), rng.integers(1, SIDE - depth - 1)
    base = int(np.median(ground[i:i + width, j:j + depth]))
    ground[i:i + width, j:j + depth] = base
    brick, roof, board = rng.integers(2, 6, 3)
    cubes[i:i + width, base:, j:j + depth] = AIR
    cubes[i:i + width, :base, j:j + depth] = board
    cubes[i:i + width, base:base + height, j:j + depth] = brick
    cubes[i + 1:i + width - 1, base:base + height, j + 1:j + depth - 1] = AIR
    cubes[i:i + width, base + height, j:j + depth] = roof
    cubes[i + width // 2, base:base + 2, j if rng.random() < 0.5 else j + depth - 1] = AIR
    for _ in range(rng.integers(1, 5)):
        side = i if rng.random() < 0.5 else i + width - 1
        cubes[side, base + 1:base + height - rng.integers(0, 2), j + rng.integers(1, depth - 1)] = AIR
    return float(i + width / 2), base + 1.0, float(j + depth / 2)


def _tree(rng: Rng, cubes: Ints, ground: Ints) -> None:
    i, j = rng.integers(2, SIDE - 2, 2)
    base, height = int(ground[i, j]), int(rng.integers(2, 5))
    if cubes[i, base, j] != AIR:
        return
    cubes[i - 1:i + 2, base + height:base + height + 2, j - 1:j + 2] = 6
    cubes[i, base:base + height + 1, j] = 5


def _add_faces(assembly: Assembly, cubes: Ints, materials: list[Material]) -> None:
    """The faces of cubes that meet air, the world's underside left out."""
    padded = np.pad(cubes, 1, constant_values=AIR)
    for (dx, dy, dz), face in FACES.items():
        beyond = padded[1 + dx:, 1 + dy:, 1 + dz:][:SIDE, :HIGHEST, :SIDE]
        shows = (cubes != AIR) & (beyond == AIR)
        for kind in np.unique(cubes[shows]).tolist():
            corners = np.argwhere(shows & (cubes == kind))
            if dy < 0:
                corners = corners[corners[:, 1] > 0]
            if len(corners):
                assembly.add(_repeated(quad(*face), corners.astype(np.float64)), materials[kind])


def _repeated(part: Part, corners: NDArray[np.float64]) -> Part:
    """The part at each of the places, shape (N, 3)."""
    count, size = len(corners), len(part.positions)
    triangles = part.triangles[None] + size * np.arange(count)[:, None, None]
    return Part((part.positions[None] + corners[:, None]).reshape(-1, 3), np.tile(part.normals, (count, 1)),
                np.tile(part.uvs, (count, 1)), triangles.reshape(-1, 3))


def _anywhere(rng: Rng, ground: Ints) -> tuple[float, float, float]:
    """A place on the ground."""
    i, j = rng.integers(1, SIDE - 1, 2)
    return float(i + 0.5), float(ground[i, j]), float(j + 0.5)


def _post(rng: Rng, assembly: Assembly, at: tuple[float, float, float]) -> None:
    """A lamp on a post: a glowing cube, or a lamp above it."""
    height = rng.uniform(1.5, 3.0)
    post = block((0.15, height, 0.15)).moved(translation(np.array(at)))
    assembly.add(post, random_material(rng))
    if rng.random() < 0.4:
        radiance = lights.strength(rng, 30.0)
        assembly.put([(joined([block((0.4, 0.4, 0.4))]), glowing(radiance))], 0.0, (at[0], at[1] + height, at[2]))
    else:
        assembly.lights.append(lights.lamp(rng, np.add(at, (0, height + 0.3, 0)), 6.0))
