"""Meshes of parallelograms, blocks and balls, and where they stand, for generated scenes."""

import numpy as np

from app.arrays import F64, Ints
from app.math3d import affine_matrix
from app.scene import Mesh

Triple = tuple[float, float, float]


def quads(name: str, material: int, *parallelograms: tuple[Triple, Triple, Triple]) -> Mesh:
    """Parallelograms given by a corner and two edges; they face u × v."""
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
    """An axis-aligned block centred at the origin; negative sizes turn its faces inward."""
    x, y, z = size
    a, b, c = -x / 2, -y / 2, -z / 2
    return quads(name, material, ((a, b, -c), (x, 0, 0), (0, y, 0)), ((-a, b, c), (-x, 0, 0), (0, y, 0)),
                 ((-a, b, -c), (0, 0, -z), (0, y, 0)), ((a, b, c), (0, 0, z), (0, y, 0)),
                 ((a, -b, -c), (x, 0, 0), (0, 0, -z)), ((a, b, c), (x, 0, 0), (0, 0, z)))


def ball(name: str, material: int, radius: float, rows: int = 12) -> Mesh:
    """A sphere centred at the origin with smooth normals."""
    columns = 2 * rows
    theta, phi = np.meshgrid(np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, columns + 1), indexing="ij")
    normals = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], axis=-1)
    normals = normals.reshape(-1, 3)
    triangles = grid_triangles(rows + 1, columns + 1).astype(np.uint32)
    return Mesh(name, (radius * normals).astype(np.float32), normals.astype(np.float32), triangles, material)


def grid_triangles(rows: int, columns: int) -> Ints:
    """Triangles, shape (T, 3), of a grid of points; they face those who see its rows go right and its columns down."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    below = first + columns
    return np.concatenate([np.stack([first, below, first + 1], 1), np.stack([first + 1, below, below + 1], 1)])


def rotation_about_y(angle: float, at: Triple = (0.0, 0.0, 0.0)) -> F64:
    """Matrix, shape (4, 4), that rotates about y by ``angle`` radians and then translates by ``at``."""
    c, s = np.cos(angle), np.sin(angle)
    return affine_matrix(np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]), at)
