"""Block worlds: terrain and houses of textured cubes, by day and by night."""

import numpy as np

from app.arrays import F64, Ints
from app.math3d import translation
from app.scene import Material
from export.dataset.scenes import lights
from export.dataset.scenes.generated_scene import GeneratedScene, GeneratedSceneBuilder, Rng
from export.dataset.scenes.materials import emissive_material, random_material
from export.dataset.scenes.parts import Part, block, quad

SIZE = 24      # cubes of a metre along x and z
HEIGHT = 16
AIR = -1
FACES = {      # by outward direction u × v: corner, u and v of the unit cube's face
    (1, 0, 0): ((1, 0, 1), (0, 0, -1), (0, 1, 0)), (-1, 0, 0): ((0, 0, 0), (0, 0, 1), (0, 1, 0)),
    (0, 1, 0): ((0, 1, 1), (1, 0, 0), (0, 0, -1)), (0, -1, 0): ((0, 0, 0), (1, 0, 0), (0, 0, 1)),
    (0, 0, 1): ((0, 0, 1), (1, 0, 0), (0, 1, 0)), (0, 0, -1): ((1, 0, 0), (-1, 0, 0), (0, 1, 0)),
}


def blocks(rng: Rng, night: bool | None = None) -> GeneratedScene:
    """A block world lit by the sun and a sky, or at night by street lights and lights in houses.

    ``night`` is random by default, with a probability of one third.
    """
    night = bool(rng.random() < 1 / 3) if night is None else night
    builder = GeneratedSceneBuilder(rng)
    ground = _terrain(rng)
    cubes = np.full((SIZE, HEIGHT, SIZE), AIR)
    cubes[np.arange(HEIGHT)[None, :, None] < ground[:, None, :]] = 0
    surface = np.arange(HEIGHT)[None, :, None] == ground[:, None, :] - 1
    cubes[surface] = 1
    materials = [random_material(rng, 0.3, 0.85, textured=0.8, metres=1.0) for _ in range(7)]
    rooms = [_add_house(rng, cubes, ground) for _ in range(rng.integers(1, 5))]
    for _ in range(rng.integers(0, 6)):
        _add_tree(rng, cubes, ground)
    _add_faces(builder, cubes, materials)
    for at in (_point_on_ground(rng, ground) for _ in range(rng.integers(0, 4))):
        crate = [(block((0.8, 0.8, 0.8)), random_material(rng, 0.2, 0.9, textured=0.5))]
        builder.add_object(crate, rng.uniform(0, np.pi), at, moves=rng.random() < 0.6)
    if not night:
        builder.lights.append(lights.sun(rng, min_elevation_deg=20.0, irradiance=12.0))
        if rng.random() < 0.5:
            builder.lights += lights.sky(rng, 3, 3.0)
    elif rng.random() < 0.4:
        builder.lights.append(lights.sun(rng, min_elevation_deg=30.0, irradiance=0.5))
    for _ in range(rng.integers(2, 5) if night else rng.integers(0, 2)):
        _add_street_light(rng, builder, _point_on_ground(rng, ground))
    for room in rooms:
        if rng.random() < (0.8 if night else 0.3):
            inside = np.add(room, (rng.uniform(-0.5, 0.5), 0.8, rng.uniform(-0.5, 0.5)))
            builder.lights.append(lights.local_light(rng, inside, 3.0))
    return builder.build("blocks", _camera_volumes(cubes, ground, rooms))


def _camera_volumes(cubes: Ints, ground: Ints, rooms: list[tuple[float, float, float]]) -> list[object]:
    """Volumes above open ground, and volumes in houses, which count 15 times."""
    columns = np.stack(np.meshgrid(np.arange(SIZE), np.arange(SIZE), indexing="ij"), -1)[2:-2, 2:-2].reshape(-1, 2)
    (x, z), top = columns.T, ground[columns[:, 0], columns[:, 1]]
    volumes = np.stack([np.column_stack([x + 0.2, top + 1.2, z + 0.2]),
                        np.column_stack([x + 0.8, top + 3.5, z + 0.8])], axis=1)
    is_open = np.array([all(cubes[i, y:y + 4, k] == AIR) for (i, k), y in zip(columns, top, strict=True)])
    indoors = [[(a - 0.8, b + 0.1, c - 0.8), (a + 0.8, b + 0.9, c + 0.8)] for a, b, c in rooms]
    return [*volumes[is_open], *indoors * 15]


def _terrain(rng: Rng) -> Ints:
    """Heights of rolling ground in cubes, shape (SIZE, SIZE)."""
    x, z = np.meshgrid(np.arange(SIZE), np.arange(SIZE), indexing="ij")
    height = np.full((SIZE, SIZE), 3.0)
    for _ in range(4):
        kx, kz = rng.uniform(-0.45, 0.45, 2)
        height += rng.uniform(0.2, 1.0) * np.sin(kx * x + kz * z + rng.uniform(0, 2 * np.pi))
    return np.clip(np.round(height), 1, 7).astype(np.int64)


def _add_house(rng: Rng, cubes: Ints, ground: Ints) -> tuple[float, float, float]:
    """Add a house on levelled ground; returns the centre of its room, a metre above the floor."""
    width, depth, height = rng.integers(5, 9), rng.integers(5, 9), rng.integers(3, 5)
    i, j = rng.integers(1, SIZE - width - 1), rng.integers(1, SIZE - depth - 1)
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


def _add_tree(rng: Rng, cubes: Ints, ground: Ints) -> None:
    i, j = rng.integers(2, SIZE - 2, 2)
    base, height = int(ground[i, j]), int(rng.integers(2, 5))
    if cubes[i, base, j] != AIR:
        return
    cubes[i - 1:i + 2, base + height:base + height + 2, j - 1:j + 2] = 6
    cubes[i, base:base + height + 1, j] = 5


def _add_faces(builder: GeneratedSceneBuilder, cubes: Ints, materials: list[Material]) -> None:
    """Add the faces of cubes that border on air, except for the underside of the world."""
    padded = np.pad(cubes, 1, constant_values=AIR)
    for (dx, dy, dz), face in FACES.items():
        beyond = padded[1 + dx:, 1 + dy:, 1 + dz:][:SIZE, :HEIGHT, :SIZE]
        visible = (cubes != AIR) & (beyond == AIR)
        for kind in np.unique(cubes[visible]).tolist():
            corners = np.argwhere(visible & (cubes == kind))
            if dy < 0:
                corners = corners[corners[:, 1] > 0]
            if len(corners):
                builder.add(_instanced(quad(*face), corners.astype(np.float64)), materials[kind])


def _instanced(part: Part, offsets: F64) -> Part:
    """Copies of the part at ``offsets``, shape (N, 3), as one."""
    count, size = len(offsets), len(part.positions)
    triangles = part.triangles[None] + size * np.arange(count)[:, None, None]
    return Part((part.positions[None] + offsets[:, None]).reshape(-1, 3), np.tile(part.normals, (count, 1)),
                np.tile(part.uvs, (count, 1)), triangles.reshape(-1, 3))


def _point_on_ground(rng: Rng, ground: Ints) -> tuple[float, float, float]:
    i, j = rng.integers(1, SIZE - 1, 2)
    return float(i + 0.5), float(ground[i, j]), float(j + 0.5)


def _add_street_light(rng: Rng, builder: GeneratedSceneBuilder, at: tuple[float, float, float]) -> None:
    """Add a post with an emissive cube on top, or with a light above it."""
    height = rng.uniform(1.5, 3.0)
    post = block((0.15, height, 0.15)).transformed(translation(np.array(at)))
    builder.add(post, random_material(rng))
    if rng.random() < 0.4:
        radiance = lights.random_light_color(rng, 30.0)
        cube = [(block((0.4, 0.4, 0.4)), emissive_material(radiance))]
        builder.add_object(cube, 0.0, (at[0], at[1] + height, at[2]))
    else:
        builder.lights.append(lights.local_light(rng, np.add(at, (0, height + 0.3, 0)), 6.0))
