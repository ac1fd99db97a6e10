"""What the emissive interiors share: materials, emissive panes, rooms and furniture that stands still."""

import colorsys
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from app.scene import Camera, Material
from export.dataset.scenes.furniture import random_furniture
from export.dataset.scenes.generated_scene import GeneratedSceneBuilder, Pieces, Rng
from export.dataset.scenes.indoors import furnish
from export.dataset.scenes.lights import random_light_color
from export.dataset.scenes.materials import (
    ceiling_material,
    emissive_material,
    floor_material,
    random_color,
    wall_material,
)
from export.dataset.scenes.parts import Part, Triple, block, quad
from export.dataset.scenes.walls import THICKNESS, Opening, Wall, add_ceiling, add_floor, add_walls

DIELECTRIC = (0.04, 0.04, 0.04)  # specular reflectance at normal incidence
OVERLAP = 0.05                   # metres
EYE_ROOM = 0.6                   # metres to each side of a camera


def polished_floor(rng: Rng) -> Material:
    """A lacquered floor."""
    return replace(floor_material(rng), specular=DIELECTRIC, roughness=float(rng.uniform(0.2, 0.45)))


def lacquer(rng: Rng) -> Material:
    """Glossy paint, as on doors and window frames."""
    return Material("surface", albedo=random_color(rng, 0.5, 0.85), specular=DIELECTRIC,
                    roughness=float(rng.uniform(0.3, 0.5)))


def metal(rng: Rng) -> Material:
    """Brass, steel or iron: a strong highlight on a dark surface."""
    tint = ((0.75, 0.6, 0.3), (0.6, 0.6, 0.62), (0.35, 0.33, 0.32))[rng.integers(3)]
    return Material("surface", albedo=(0.08, 0.08, 0.08), specular=tint, roughness=float(rng.uniform(0.25, 0.5)))


def saturated_wall(rng: Rng) -> Material:
    """Wall paint of a strong colour."""
    saturation, value = rng.uniform((0.45, 0.5), (0.85, 0.8)).tolist()
    return Material("surface", albedo=colorsys.hsv_to_rgb(rng.random(), saturation, value))


def wall_materials(rng: Rng, count: int) -> list[Material]:
    """Materials of ``count`` walls, one or two of them of a strong colour."""
    plain = wall_material(rng)
    colored = set(rng.choice(count, size=min(count, int(rng.integers(1, 3))), replace=False).tolist())
    return [saturated_wall(rng) if k in colored else plain for k in range(count)]


def emitter(rng: Rng, radiance: float, saturated: float = 0.15) -> Material:
    """A material that emits about ``radiance`` W/(sr m²), warm or cool white or, more rarely, of any hue."""
    tint = np.array(random_light_color(rng, 1.0, saturated))
    r, g, b = (tint / tint.max() * radiance * rng.uniform(0.75, 1.25)).tolist()
    return emissive_material((r, g, b))


def emissive_pane(rng: Rng, radiance: float, corner: Triple, u: Triple, v: Triple) -> tuple[Part, Material]:
    """A parallelogram that emits along u × v only."""
    return quad(corner, u, v), replace(emitter(rng, radiance), double_sided=False)


def add_shell(rng: Rng, builder: GeneratedSceneBuilder, walls: Sequence[Wall], width: float,
              depth: float) -> list[Material]:
    """Add walls, a polished floor and a ceiling around the origin; return the materials of the walls."""
    materials = wall_materials(rng, len(walls))
    add_walls(builder, list(walls), materials)
    add_floor(builder, width, depth, polished_floor(rng))
    add_ceiling(builder, width, depth, walls[0].height, ceiling_material(rng))
    return materials


def partition(width: float, z: float, height: float, left: float, right: float, top: float) -> Wall:
    """A wall behind ``z`` across a room of ``width``, with an opening between two x from the floor to ``top``.

    It reaches into the side walls and the ceiling, so that no ray passes between them.
    """
    half = width / 2 + OVERLAP
    end = half - THICKNESS  # a wall goes on by its thickness
    return Wall(np.array([-half, z]), np.array([end, z]), height + OVERLAP, (
        Opening(left + half, right + half, 0.0, top),))


def reserve_camera(builder: GeneratedSceneBuilder, eye: Triple, target: Triple) -> Camera:
    """A camera that looks at ``target``, around whose eye no furniture will stand."""
    builder.blocked_volumes.append(eye + np.array([[-EYE_ROOM, -eye[1], -EYE_ROOM], [EYE_ROOM, EYE_ROOM, EYE_ROOM]]))
    return Camera(eye, target, fov_y_deg=62.0)


def furnish_statically(rng: Rng, builder: GeneratedSceneBuilder, width: float, depth: float, per_area: float,
                       centre: tuple[float, float] = (0.0, 0.0)) -> None:
    """Add furniture that does not move to a rectangle with its centre at (x, z) = ``centre``."""
    furnish(rng, builder, width, depth, random_furniture, per_area, centre, moving_share=0.0)


def dining_table(rng: Rng) -> Pieces:
    """A polished table with a few boxes on it."""
    top = replace(lacquer(rng), albedo=random_color(rng, 0.3, 0.7))
    width, depth, height = rng.uniform(1.1, 1.5), rng.uniform(0.7, 0.9), rng.uniform(0.72, 0.76)
    x, z = width / 2 - 0.05, depth / 2 - 0.05
    pieces: Pieces = [(block((width, 0.035, depth), (0, height - 0.035, 0)), top)]
    pieces += [(block((0.06, height - 0.035, 0.06), (i * x, 0, j * z)), top) for i in (-1, 1) for j in (-1, 1)]
    for _ in range(rng.integers(2, 5)):
        at = (rng.uniform(-0.4, 0.4) * width, height, rng.uniform(-0.35, 0.35) * depth)
        size = rng.uniform(0.06, 0.2, 3)
        pieces.append((block((size[0], size[1], size[2]), at), saturated_wall(rng)))
    return pieces
