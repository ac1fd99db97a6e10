"""Displaced primitives above a displaced ground, as in Suppan et al.: bumps, hollows and their shadows."""

import math
from collections.abc import Callable

import numpy as np

from app.arrays import F64
from export.dataset.scenes.generated_scene import GeneratedScene, GeneratedSceneBuilder, Rng
from export.dataset.scenes.materials import random_material
from export.dataset.scenes.parts import Part

Surface = Callable[[F64, F64], F64]  # points, shape (..., 3), at u and v in [0, 1]

GRID = 48               # quads along each side of a primitive
WAVES = 10              # summed up to a height map
GROUND_HALF_SIZE = 6.0  # metres


def primitives(rng: Rng) -> GeneratedScene:
    """Three to nine spheres, boxes, columns and rings within 6 metres, some of them above others."""
    builder = GeneratedSceneBuilder(rng)
    builder.add(_displaced(rng, _ground, 0.25), random_material(rng))
    for _ in range(rng.integers(3, 10)):
        shape = (_sphere, _box, _column, _ring)[rng.integers(4)]
        part = _displaced(rng, shape, 0.12, rng.uniform(0.4, 1.4, 3))
        tilt = _random_rotation(rng)
        at = (rng.uniform(-3, 3), rng.uniform(0.2, 2.2), rng.uniform(-3, 3))
        builder.add_object([(part.transformed(tilt), random_material(rng))], float(rng.uniform(0, 2 * math.pi)), at,
                     moves=rng.random() < 0.2)
    sides = ((-5.5, -3.5, -5.5, 5.5), (3.5, 5.5, -5.5, 5.5), (-3.5, 3.5, -5.5, -3.5), (-3.5, 3.5, 3.5, 5.5))
    return builder.build("primitives", [[[x0, 0.6, z0], [x1, 3.5, z1]] for x0, x1, z0, z1 in sides])


def _displaced(rng: Rng, surface: Surface, height: float, size: float | F64 = 1.0) -> Part:
    """The surface as a grid, scaled by ``size`` and displaced along its normals by up to about ``height`` metres."""
    v, u = np.meshgrid(np.linspace(0, 1, GRID + 1), np.linspace(0, 1, GRID + 1), indexing="ij")
    points = surface(u, v) * size
    height *= float(rng.random())
    waves = sum(np.sin(points @ rng.normal(0, 1, 3) * rng.uniform(1, 9) + rng.uniform(0, 2 * math.pi)) / WAVES**0.5
                for _ in range(WAVES))
    points = points + (height * np.asarray(waves))[..., None] * _normals(points)
    first = (np.arange(GRID)[:, None] * (GRID + 1) + np.arange(GRID)).ravel()
    after = first + GRID + 1
    triangles = np.concatenate([np.stack([first, first + 1, after + 1], 1), np.stack([first, after + 1, after], 1)])
    return Part(points.reshape(-1, 3), _normals(points).reshape(-1, 3), np.stack([u, v], -1).reshape(-1, 2) * 3,
                triangles)


def _normals(points: F64) -> F64:
    """Unit normals u × v of a grid of points, by finite differences."""
    n = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    return np.asarray(n / np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-12))


def _ground(u: F64, v: F64) -> F64:
    return np.stack([(2 * u - 1) * GROUND_HALF_SIZE, np.zeros_like(u), (1 - 2 * v) * GROUND_HALF_SIZE], axis=-1)


def _sphere(u: F64, v: F64) -> F64:
    phi, theta = 2 * math.pi * u, math.pi * (0.001 + 0.998 * v)
    return np.stack([np.sin(phi) * np.sin(theta), np.cos(theta), np.cos(phi) * np.sin(theta)], -1)


def _box(u: F64, v: F64) -> F64:
    """A box with rounded edges: a sphere of the 6-norm."""
    d = _sphere(u, v)
    return np.asarray(d / np.linalg.norm(d, ord=6, axis=-1, keepdims=True))


def _column(u: F64, v: F64) -> F64:
    phi = 2 * math.pi * u
    radius = np.clip(np.minimum(v, 1 - v) * 6, 1e-3, 1)  # the ends are closed
    height = np.clip((v - 0.5) * 1.5, -0.5, 0.5) * 2
    return np.stack([radius * np.sin(phi) / 2, -height, radius * np.cos(phi) / 2], -1)


def _ring(u: F64, v: F64) -> F64:
    phi, theta = 2 * math.pi * u, 2 * math.pi * v
    radius = 0.75 + 0.25 * np.cos(theta)
    return np.stack([radius * np.sin(phi), -0.25 * np.sin(theta), radius * np.cos(phi)], -1)


def _random_rotation(rng: Rng) -> F64:
    """Matrix, shape (4, 4), of a uniformly random rotation."""
    q, _ = np.linalg.qr(rng.normal(0, 1, (3, 3)))
    m = np.eye(4)
    m[:3, :3] = q * np.sign(np.linalg.det(q))
    return m
