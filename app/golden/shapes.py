"""Meshes and places made in code, for the catalogue's scenes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.math3d import translation
from app.scene import Mesh

Triple = tuple[float, float, float]
F64 = NDArray[np.float64]


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


def mirrored(offset: Triple) -> F64:
    """Matrix that mirrors x, then moves by ``offset``."""
    m = translation(np.asarray(offset, np.float64))
    m[0, 0] = -1.0
    return m
