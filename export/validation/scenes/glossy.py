"""Scenes of glossy surfaces: rows of spheres, a mirror, a polished floor, and a room of rough steel.

They are closed rooms, whose walls differ in colour, so that what a surface reflects shows where it comes from.
"""

from collections.abc import Callable, Sequence

import numpy as np

from app.arrays import F64, Bools
from app.math3d import View, translation
from app.scene import Camera, CameraPath, Instance, Light, Material, Mesh, PointLight, RectLight, Scene, bounds_of
from app.simple_meshes import ball, block, quads, rotation_about_y
from export.reference.still import Still

ROUGHNESSES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)  # of the spheres of a row, from left to right
SPHERE_RADIUS, SPHERE_SPACING = 0.4, 1.0      # metres, as all lengths here
WIDTH, HEIGHT, DEPTH = 7.0, 3.0, 5.0          # of the rooms
DIELECTRIC = (0.04,) * 3
GOLD = (1.0, 0.78, 0.34)                      # reflectance at normal incidence, linear
STEEL = (0.56, 0.57, 0.58)
PAINT = {name: Material(name, albedo=color) for name, color in {
    "white": (0.75, 0.73, 0.7), "red": (0.6, 0.15, 0.1), "green": (0.15, 0.45, 0.18), "blue": (0.12, 0.22, 0.55),
    "wood": (0.45, 0.3, 0.18), "yellow": (0.7, 0.5, 0.08)}.items()}
PANEL = RectLight((0.0, HEIGHT - 0.02, 0.5), (2.0, 0.0, 0.0), (0.0, 0.0, 1.0), (12.0, 11.5, 10.5))

Piece = tuple[Mesh, Material, F64]


def sphere_row(metallic: bool) -> Scene:
    """Spheres of ``ROUGHNESSES`` in a room: gold, or white dielectrics."""
    pieces = _room(PAINT["wood"])
    for x, roughness in zip(sphere_centers(), ROUGHNESSES, strict=True):
        material = (Material("sphere", albedo=GOLD, metallic=1.0, roughness=roughness) if metallic
                    else Material("sphere", albedo=(0.5,) * 3, specular=DIELECTRIC, roughness=roughness))
        pieces.append((ball("sphere", 0, SPHERE_RADIUS, 48), material, translation(np.array(x))))
    return _build("spheres", pieces, [PANEL], Camera((0.0, 1.2, 2.4), (0.0, 0.5, -0.6), fov_y_deg=38.0))


def sphere_centers() -> list[tuple[float, float, float]]:
    """Of the spheres of a row, from left to right."""
    middle = (len(ROUGHNESSES) - 1) / 2
    return [(SPHERE_SPACING * (i - middle), SPHERE_RADIUS, -0.6) for i in range(len(ROUGHNESSES))]


def spheres_seen(still: Still) -> list[Bools]:
    """Which pixels show each sphere of a row, shape (H, W), but for its edge."""
    w, h = still.size
    x, y = np.meshgrid((np.arange(w) + 0.5) / w * 2 - 1, 1 - (np.arange(h) + 0.5) / h * 2)
    view: View = still.view
    _, towards = view.rays(np.stack([x.ravel(), y.ravel()], axis=1))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    pixel = 2 * np.tan(np.radians(still.camera.fov_y_deg) / 2) / h
    shown = []
    for center in sphere_centers():
        to = np.asarray(center) - view.eye
        along = towards @ to
        distance = np.sqrt(np.maximum(to @ to - along**2, 0))
        shown.append((distance < SPHERE_RADIUS - 1.5 * pixel * along).reshape(h, w))
    return shown


def mirror_room() -> Scene:
    """A wall with a mirror that shows what is behind the camera: coloured blocks and the wall there."""
    mirror = Material("mirror", albedo=(0.95,) * 3, metallic=1.0, roughness=0.0)
    pieces = _room(PAINT["wood"], front=PAINT["blue"])
    pieces.append((quads("mirror", 0, ((-1.4, 0.5, -DEPTH / 2 + 0.02), (2.8, 0, 0), (0, 2.0, 0))), mirror, np.eye(4)))
    pieces += [(block("block", 0, (0.6, 1.4, 0.6)), PAINT["yellow"], rotation_about_y(0.4, (-1.3, 0.7, 1.9))),
               (block("block", 0, (0.7, 0.8, 0.7)), PAINT["white"], rotation_about_y(-0.3, (1.2, 0.4, 1.8))),
               (ball("ball", 0, 0.3, 32), PAINT["red"], translation(np.array((0.9, 0.3, -1.6))))]
    return _build("mirror", pieces, [PANEL], Camera((0.3, 1.5, 1.2), (-0.1, 1.3, -2.5), fov_y_deg=55.0))


def polished_room() -> Scene:
    """Blocks on a floor of polished stone, seen low above it, and a glass front before one wall."""
    stone = Material("stone", albedo=(0.18, 0.17, 0.16), specular=DIELECTRIC, roughness=0.08)
    lacquer = Material("lacquer", albedo=(0.03, 0.03, 0.035), specular=DIELECTRIC, roughness=0.0)
    pieces = _room(stone)
    pieces += [(quads("front", 0, ((-WIDTH / 2 + 0.03, 0.3, 0.5), (0, 0, -2.5), (0, 2.0, 0))), lacquer, np.eye(4)),
               (block("block", 0, (0.7, 1.2, 0.7)), PAINT["yellow"], rotation_about_y(0.5, (-1.0, 0.6, -1.3))),
               (block("block", 0, (1.0, 0.5, 0.6)), PAINT["blue"], rotation_about_y(-0.2, (0.9, 0.25, -0.9))),
               (ball("ball", 0, 0.4, 32), PAINT["white"], translation(np.array((-2.2, 0.4, -0.6))))]
    return _build("polished", pieces, [PANEL], Camera((1.6, 0.8, 2.2), (-1.0, 0.6, -1.2), fov_y_deg=50.0))


def steel_room() -> Scene:
    """A room of rough steel: walls, ceiling and floor; only a block and a ball in it are painted."""
    steel = Material("steel", albedo=STEEL, metallic=1.0, roughness=0.6)
    brushed = Material("brushed", albedo=STEEL, metallic=1.0, roughness=0.3)
    pieces: list[Piece] = [
        (block("shell", 0, (-WIDTH, -HEIGHT, -DEPTH)), steel, translation(np.array((0.0, HEIGHT / 2, 0.0)))),
        (block("table", 0, (1.8, 0.9, 0.7)), brushed, rotation_about_y(0.2, (-0.8, 0.45, -1.0))),
        (block("block", 0, (0.7, 1.3, 0.7)), PAINT["red"], rotation_about_y(-0.4, (1.4, 0.65, -1.2))),
        (ball("ball", 0, 0.35, 32), PAINT["white"], translation(np.array((0.5, 0.35, 0.0))))]
    lamp = PointLight((-1.5, 2.2, 0.8), (4.0, 3.9, 3.7), 0.1)
    return _build("steel", pieces, [lamp], Camera((0.8, 1.6, 2.2), (-0.1, 0.7, -1.2), fov_y_deg=55.0))


GLOSSY_SOURCES: dict[str, Callable[[], Scene]] = {
    "metal-spheres": lambda: sphere_row(True), "dielectric-spheres": lambda: sphere_row(False),
    "mirror-room": mirror_room, "polished-room": polished_room, "steel-room": steel_room,
}
SPHERE_ROWS = ("metal-spheres", "dielectric-spheres")


def _room(floor: Material, front: Material = PAINT["white"]) -> list[Piece]:
    """A closed room with walls of their own colours; ``front`` is behind the cameras, towards +z."""
    x, y, z = WIDTH / 2, HEIGHT, DEPTH / 2
    walls = {
        "floor": (floor, ((-x, 0, z), (2 * x, 0, 0), (0, 0, -2 * z))),
        "ceiling": (PAINT["white"], ((-x, y, -z), (2 * x, 0, 0), (0, 0, 2 * z))),
        "back": (PAINT["white"], ((-x, 0, -z), (2 * x, 0, 0), (0, y, 0))),
        "front": (front, ((x, 0, z), (-2 * x, 0, 0), (0, y, 0))),
        "left": (PAINT["red"], ((-x, 0, z), (0, 0, -2 * z), (0, y, 0))),
        "right": (PAINT["green"], ((x, 0, -z), (0, 0, 2 * z), (0, y, 0))),
    }
    return [(quads(name, 0, parallelogram), material, np.eye(4)) for name, (material, parallelogram) in walls.items()]


def _build(name: str, pieces: Sequence[Piece], lights: Sequence[Light], camera: Camera) -> Scene:
    materials = list({id(material): material for _, material, _ in pieces}.values())
    index = {id(material): number for number, material in enumerate(materials)}
    meshes = tuple(Mesh(mesh.name, mesh.positions, mesh.normals, mesh.triangles, index[id(material)], uvs=mesh.uvs)
                   for mesh, material, _ in pieces)
    instances = tuple(Instance(mesh.name, number, place) for number, (mesh, (_, _, place))
                      in enumerate(zip(meshes, pieces, strict=True)))
    return Scene(name, meshes, instances, tuple(materials), tuple(lights), {"main": CameraPath.still(camera)}, "main",
                 bounds_of(meshes, instances))
