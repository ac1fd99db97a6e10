"""A generated scene whose numbers of triangles and lights can be chosen: a room over rolling ground."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from app.math3d import translation
from app.scene import Camera, CameraPath, Instance, Material, Mesh, Motion, PointLight, Scene, bounds_of

WIDTH, HEIGHT = 8.0, 4.0
MATERIALS = (Material("ground", (0.5, 0.55, 0.4)), Material("walls", (0.7, 0.68, 0.65)),
             Material("ball", (0.7, 0.25, 0.2)))
VIEW = Camera((0.0, 2.4, 3.7), (0.0, 0.9, -1.0), fov_y_deg=60.0)
FLUX = 12.0  # of all lights together, W/sr

F64 = NDArray[np.float64]


def hall(triangles: int, lights: int) -> Scene:
    """A closed room with ``lights`` small lamps and ground of about ``triangles`` triangles.

    A block moves to and fro, so that every lamp's shadows are drawn anew in each frame.
    """
    meshes = (_ground(max(2, round(math.sqrt(triangles / 2)))), _box("walls", (WIDTH, HEIGHT, WIDTH), 1, inward=True),
              _box("block", (0.6, 0.6, 0.6), 2, inward=False))
    times = np.arange(0.0, 600.0, 0.5)
    to_and_fro = np.stack([translation(np.array([-1.0 if i % 2 else 1.0, 1.2, -0.5])) for i in range(len(times))])
    instances = (Instance("ground", 0, np.eye(4)), Instance("walls", 1, translation(np.array([0, HEIGHT / 2, 0]))),
                 Instance("block", 2, np.eye(4), Motion(times, to_and_fro)))
    angles = 2 * np.pi * np.arange(lights) / lights
    lamps = tuple(PointLight((2.2 * math.cos(a), HEIGHT - 0.6, 2.2 * math.sin(a)), (FLUX / lights,) * 3, 0.05)
                  for a in angles.tolist())
    return Scene("hall", meshes, instances, MATERIALS, lamps, {"main": CameraPath.still(VIEW)}, "main",
                 bounds_of(meshes, instances))


def _ground(cells: int) -> Mesh:
    """A height field of ``cells`` × ``cells`` squares."""
    at = np.linspace(-WIDTH / 2, WIDTH / 2, cells + 1)
    x, z = np.meshgrid(at, at, indexing="ij")
    height = 0.3 + 0.15 * np.sin(2 * x) * np.cos(3 * z)
    slope_x, slope_z = 0.3 * np.cos(2 * x) * np.cos(3 * z), -0.45 * np.sin(2 * x) * np.sin(3 * z)
    normals = np.stack([-slope_x, np.ones_like(x), -slope_z], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    corner = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return Mesh("ground", np.stack([x, height, z], -1).reshape(-1, 3).astype(np.float32),
                normals.reshape(-1, 3).astype(np.float32), faces.astype(np.uint32), 0)


def _box(name: str, size: tuple[float, float, float], material: int, inward: bool) -> Mesh:
    """A block around the origin; ``inward`` turns its faces to the inside."""
    positions: list[F64] = []
    faces: list[list[int]] = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            u, v, n = (np.eye(3)[(axis + k) % 3] for k in (1, 2, 0))
            first = len(positions)
            positions += [side * n + s * side * u + t * v for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
            order = (0, 2, 1, 0, 3, 2) if inward else (0, 1, 2, 0, 2, 3)
            faces += [[first + k for k in order[:3]], [first + k for k in order[3:]]]
    at = (np.asarray(positions) * np.asarray(size) / 2).astype(np.float32)
    return Mesh(name, at, np.zeros_like(at), np.asarray(faces, np.uint32), material)
