"""The catalogue: small scenes made in code, so that no file, loader or network download stands behind a golden."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.math3d import translation
from app.scene import (
    Camera,
    CameraPath,
    DirectionalLight,
    Instance,
    Material,
    Mesh,
    Motion,
    PointLight,
    RectLight,
    Scene,
    SpotLight,
    Texture,
    bounds_of,
)

FRAME_SECONDS = 1 / 30

Triple = tuple[float, float, float]
F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Case:
    """One scene of the catalogue.

    Attributes
    ----------
    model : str or None
        A bundled network, or none.
    frames : int
        Length of the sequence; the scene's default camera moves, 1/30 s a frame.
    kept : tuple of int
        Frames whose images become goldens, counted from 1.
    """

    scene: Scene
    model: str | None
    frames: int = 3
    kept: tuple[int, ...] = (3,)
    size: tuple[int, int] = (256, 192)

    @property
    def name(self) -> str:
        return self.scene.name


def catalogue() -> dict[str, Case]:
    """All cases by name, in the order in which they are checked."""
    return {case.name: case for case in (Case(room(), "radiosity"), Case(outdoor(), "gather"))}


def room() -> Scene:
    """A box with coloured walls, a sphere light, a glossy block and ball, a rough block and a glowing panel."""
    materials = (
        Material("white", albedo=(0.75, 0.75, 0.75)),
        Material("red", albedo=(0.65, 0.06, 0.05)),
        Material("green", albedo=(0.1, 0.5, 0.12)),
        Material("glossy", albedo=(0.3, 0.3, 0.35), roughness=0.25, specular=(0.2, 0.2, 0.2)),
        Material("panel", albedo=(0.1, 0.1, 0.1), emission=(1.5, 2.0, 3.0), double_sided=False),
    )
    meshes = (
        quads("shell", 0, ((-1, -1, -1), (0, 0, 2), (2, 0, 0)), ((-1, 1, -1), (2, 0, 0), (0, 0, 2)),
              ((-1, -1, -1), (2, 0, 0), (0, 2, 0))),
        quads("left", 1, ((-1, -1, -1), (0, 2, 0), (0, 0, 2))),
        quads("right", 2, ((1, -1, -1), (0, 0, 2), (0, 2, 0))),
        block("tall", 3, (0.5, 1.1, 0.5)),
        block("low", 0, (0.5, 0.4, 0.5)),
        ball("ball", 3, 0.22),
        quads("panel", 4, ((0.05, 0.0, -0.98), (0.6, 0, 0), (0, 0.5, 0))),
    )
    places = {3: turned(0.35, (-0.45, -0.45, -0.35)), 4: turned(-0.3, (0.4, -0.8, -0.2)),
              5: turned(0.0, (0.4, -0.38, -0.2))}
    lights = (PointLight((0.1, 0.75, 0.1), (1.4, 1.3, 1.1), radius=0.12),)
    first = Camera((0.0, 0.05, 0.98), (0.0, -0.2, -0.5), fov_y_deg=75.0)
    return _scene("room", meshes, places, materials, lights, first, replace(first, eye=(0.03, 0.06, 0.96)))


def outdoor() -> Scene:
    """Sun, hard spot and glowing rectangle over a coloured ground, with a masked card and a block that moves."""
    pattern = np.full((16, 16, 4), 255, np.uint8)
    pattern[..., 1] = np.arange(16)[:, None] * 16
    pattern[..., 2] = np.arange(16) * 16
    pattern[..., 3] = 255 * ((np.arange(16)[:, None] // 4 + np.arange(16) // 4) % 2)
    materials = (
        Material("ground"),
        Material("card", albedo=(0.9, 0.9, 0.9), albedo_map=Texture(pattern), alpha_cutoff=0.5),
        Material("block", albedo=(0.2, 0.35, 0.7), roughness=0.4, specular=(0.04, 0.04, 0.04)),
        Material("lamp", emission=(4.0, 3.0, 2.0), analytic=True),
    )
    ground = quads("ground", 0, ((-4, 0, 4), (8, 0, 0), (0, 0, -8)))
    corners = np.array([[0.8, 0.3, 0.2, 1], [0.3, 0.8, 0.2, 1], [0.3, 0.3, 0.9, 1], [0.8, 0.8, 0.8, 1]], np.float32)
    edge_u, edge_v = (0.0, 0.6, 0.0), (0.0, 0.0, 0.8)
    meshes = (
        replace(ground, colors=corners),
        quads("card", 1, ((-0.9, 0.0, -0.6), (1.4, 0, 0), (0, 1.4, 0))),
        block("block", 2, (0.5, 0.5, 0.5)),
        quads("lamp", 3, ((-1.9, 0.5, -0.4), edge_u, edge_v)),
    )
    ways = np.stack([np.eye(4), turned(0.4, (0.3, 0.1, 0.2))])
    motions = {2: Motion(np.array([0.0, 4 * FRAME_SECONDS]), ways)}
    lights = (
        DirectionalLight((-0.5, -1.0, 0.4), (1.5, 1.4, 1.2), angular_radius_deg=1.5),
        SpotLight((1.6, 2.0, 1.0), (-0.6, -1.0, -0.5), (5.0, 1.0, 4.0), inner_deg=14.0, outer_deg=24.0),
        RectLight((-1.9, 0.8, 0.0), edge_u, edge_v, (4.0, 3.0, 2.0)),
    )
    first = Camera((0.5, 1.1, 3.4), (0.0, 0.45, 0.0), fov_y_deg=45.0)
    return _scene("outdoor", meshes, {2: turned(0.2, (0.9, 0.3, 0.5))}, materials, lights, first,
                  replace(first, eye=(0.45, 1.12, 3.4)), motions)


def quads(name: str, material: int, *parallelograms: tuple[Triple, Triple, Triple]) -> Mesh:
    """Parallelograms from a corner along two edges, seen from the side of edge u × edge v."""
    corner, u, v = np.moveaxis(np.array(parallelograms, np.float64), 1, 0)
    positions = np.stack([corner, corner + u, corner + u + v, corner + v], axis=1)
    normals = np.cross(u, v)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    count = len(parallelograms)
    triangles = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(count)[:, None, None]
    return Mesh(name, positions.reshape(-1, 3).astype(np.float32), np.repeat(normals, 4, axis=0).astype(np.float32),
                triangles.reshape(-1, 3).astype(np.uint32), material,
                uvs=np.tile(np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32), (count, 1)))


def block(name: str, material: int, size: Triple) -> Mesh:
    """An axis-parallel block around the origin."""
    x, y, z = size
    a, b, c = -x / 2, -y / 2, -z / 2
    return quads(name, material, ((a, b, -c), (x, 0, 0), (0, y, 0)), ((-a, b, c), (-x, 0, 0), (0, y, 0)),
                 ((-a, b, -c), (0, 0, -z), (0, y, 0)), ((a, b, c), (0, 0, z), (0, y, 0)),
                 ((a, -b, -c), (x, 0, 0), (0, 0, -z)), ((a, b, c), (x, 0, 0), (0, 0, z)))


def ball(name: str, material: int, radius: float, rows: int = 12) -> Mesh:
    """A sphere around the origin with smooth normals."""
    columns = 2 * rows
    theta, phi = np.meshgrid(np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, columns + 1), indexing="ij")
    normals = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], axis=-1)
    normals = normals.reshape(-1, 3)
    at = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below = at + columns + 1
    triangles = np.concatenate([np.stack([at, below, at + 1], axis=1), np.stack([at + 1, below, below + 1], axis=1)])
    return Mesh(name, (radius * normals).astype(np.float32), normals.astype(np.float32), triangles.astype(np.uint32),
                material)


def turned(angle: float, offset: Triple) -> F64:
    """Matrix that turns by ``angle`` radians about y, then moves by ``offset``."""
    m = translation(np.asarray(offset, np.float64))
    m[0, 0] = m[2, 2] = np.cos(angle)
    m[0, 2], m[2, 0] = np.sin(angle), -np.sin(angle)
    return m


def _scene(name: str, meshes: tuple[Mesh, ...], places: dict[int, F64], materials: tuple[Material, ...],
           lights: tuple[PointLight | DirectionalLight | SpotLight | RectLight, ...], first: Camera, last: Camera,
           motions: dict[int, Motion] | None = None) -> Scene:
    """One instance of each mesh, and a camera that goes from ``first`` to ``last`` within four frames."""
    instances = tuple(Instance(m.name, i, places.get(i, np.eye(4)), (motions or {}).get(i))
                      for i, m in enumerate(meshes))
    path = CameraPath((0.0, 4 * FRAME_SECONDS), (first, last))
    return Scene(name, meshes, instances, materials, lights, {"path": path}, "path", bounds_of(meshes, instances))
