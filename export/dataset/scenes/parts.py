"""Boxes, cylinders and spheres in metres. Texture coordinates are in metres too, so that textures keep their size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.arrays import F64, Ints
from app.simple_meshes import grid_triangles

Triple = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles without a material.

    Attributes
    ----------
    positions, normals : ndarray, float64, shape (V, 3)
    uvs : ndarray, float64, shape (V, 2)
        In metres along the surface.
    triangles : ndarray, int64, shape (T, 3)
    """

    positions: F64
    normals: F64
    uvs: F64
    triangles: Ints

    def transformed(self, transform: F64) -> Part:
        """The part under a rigid transform, shape (4, 4)."""
        rotation = transform[:3, :3].T
        return Part(self.positions @ rotation + transform[:3, 3], self.normals @ rotation, self.uvs, self.triangles)

    @property
    def bounds(self) -> F64:
        """Minimum and maximum, shape (2, 3)."""
        return np.stack([self.positions.min(axis=0), self.positions.max(axis=0)])


def merge(parts: list[Part]) -> Part:
    """Merge parts into one."""
    offsets = np.cumsum([0, *(len(p.positions) for p in parts[:-1])])
    triangles = np.concatenate([part.triangles + offset for part, offset in zip(parts, offsets, strict=True)])
    positions, normals, uvs = (np.concatenate([getattr(part, name) for part in parts])
                               for name in ("positions", "normals", "uvs"))
    return Part(positions, normals, uvs, triangles)


def quad(corner: Triple, u: Triple, v: Triple) -> Part:
    """A parallelogram that faces along u × v."""
    c, a, b = (np.asarray(x, np.float64) for x in (corner, u, v))
    normal = np.cross(a, b)
    s, t = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    return Part(np.stack([c, c + a, c + a + b, c + b]), np.tile(normal / np.linalg.norm(normal), (4, 1)),
                np.array([[0, 0], [s, 0], [s, t], [0, t]]), np.array([[0, 1, 2], [0, 2, 3]]))


_CUBE = merge([quad((0, 0, 1), (1, 0, 0), (0, 1, 0)), quad((1, 0, 0), (-1, 0, 0), (0, 1, 0)),
                quad((1, 0, 1), (0, 0, -1), (0, 1, 0)), quad((0, 0, 0), (0, 0, 1), (0, 1, 0)),
                quad((0, 1, 1), (1, 0, 0), (0, 0, -1)), quad((0, 0, 0), (1, 0, 0), (0, 0, 1))])
_EDGES = np.array([[0, 1], [0, 1], [2, 1], [2, 1], [0, 2], [0, 2]]).repeat(4, axis=0)  # axes of u and v on each face


def slab(low: Triple, high: Triple) -> Part:
    """The axis-aligned box between two corners."""
    size = np.subtract(high, low)
    return Part(_CUBE.positions * size + low, _CUBE.normals, _CUBE.uvs * size[_EDGES], _CUBE.triangles)


def block(size: Triple, at: Triple = (0.0, 0.0, 0.0)) -> Part:
    """An axis-aligned box whose bottom is centred at ``at``."""
    (x, y, z), (a, b, c) = size, at
    return slab((a - x / 2, b, c - z / 2), (a + x / 2, b + y, c + z / 2))


def cylinder(radius: float, height: float, at: Triple = (0.0, 0.0, 0.0), sides: int = 20) -> Part:
    """An upright closed cylinder whose bottom is centred at ``at``."""
    phi = np.linspace(0, 2 * np.pi, sides + 1)
    ring = np.stack([np.cos(phi), np.zeros_like(phi), -np.sin(phi)], axis=1)
    base = np.asarray(at, np.float64)
    k = np.arange(sides)
    side = np.concatenate([np.stack([k, k + 1, k + sides + 2], 1), np.stack([k, k + sides + 2, k + sides + 1], 1)])
    hull = Part(np.concatenate([base + radius * ring, base + radius * ring + (0, height, 0)]), np.tile(ring, (2, 1)),
                np.stack([np.tile(phi * radius, 2), np.repeat([0.0, height], sides + 1)], axis=1), side)
    caps = []
    for y, sign in ((height, 1.0), (0.0, -1.0)):
        points = np.concatenate([[(0, 0, 0)], radius * ring]) + base + (0, y, 0)
        fan = np.stack([np.zeros_like(k), k + 1, k + 2], axis=1)
        caps.append(Part(points, np.tile([0.0, sign, 0.0], (sides + 2, 1)), points[:, [0, 2]],
                         fan if sign > 0 else fan[:, ::-1]))
    return merge([hull, *caps])


def sphere(radius: float, at: Triple = (0.0, 0.0, 0.0), rows: int = 12) -> Part:
    """A sphere around ``at``."""
    columns = 2 * rows
    theta, phi = np.meshgrid(np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, columns + 1), indexing="ij")
    normals = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], axis=-1)
    return Part((np.asarray(at) + radius * normals).reshape(-1, 3), normals.reshape(-1, 3),
                np.stack([phi * radius, -theta * radius], axis=-1).reshape(-1, 2),
                grid_triangles(rows + 1, columns + 1))
