"""Height-mapped primitives on a height-mapped ground, as in Suppan et al.: bumps, hollows and their shadows."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from export.dataset.scenes.assembly import Assembly
from export.dataset.scenes.generated_scene import GeneratedScene, Rng
from export.dataset.scenes.materials import random_material
from export.dataset.scenes.parts import Part

F64 = NDArray[np.float64]
Surface = Callable[[F64, F64], F64]  # points, shape (..., 3), at u and v in [0, 1]

GRID = 48     # quads along a primitive
WAVES = 10    # of a height map
HALF = 6.0    # metres from the middle to the ground's edge


def primitives(rng: Rng) -> GeneratedScene:
    """Three to nine spheres, blocks, columns and rings within 6 metres, some of them above others."""
    assembly = Assembly(rng)
    assembly.add(_bumpy(rng, _ground, 0.25), random_material(rng))
    for _ in range(rng.integers(3, 10)):
        shape = (_ball, _block, _column, _ring)[rng.integers(4)]
        part = _bumpy(rng, shape, 0.12, rng.uniform(0.4, 1.4, 3))
        tilt = _about(rng)
        at = (rng.uniform(-3, 3), rng.uniform(0.2, 2.2), rng.uniform(-3, 3))
        assembly.put([(part.moved(tilt), random_material(rng))], float(rng.uniform(0, 2 * math.pi)), at,
                     moves=rng.random() < 0.2)
    low, high = 0.6, 3.5
    free = [[[a, low, c], [b, high, d]] for a, b, c, d in ((-5.5, -3.5, -5.5, 5.5), (3.5, 5.5, -5.5, 5.5),
                                                           (-3.5, 3.5, -5.5, -3.5), (-3.5, 3.5, 3.5, 5.5))]
    return assembly.place("primitives", free)


def _bumpy(rng: Rng, surface: Surface, height: float, size: float | F64 = 1.0) -> Part:
    """The surface as a grid times ``size``, moved along its normals by waves up to about ``height`` metres high."""
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
    """Of a grid of points, u × v; seams and poles take what the differences give there."""
    n = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    return np.asarray(n / np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-12))


def _ground(u: F64, v: F64) -> F64:
    return np.stack([(2 * u - 1) * HALF, np.zeros_like(u), (1 - 2 * v) * HALF], axis=-1)


def _ball(u: F64, v: F64) -> F64:
    turn, down = 2 * math.pi * u, math.pi * (0.001 + 0.998 * v)
    return np.stack([np.sin(turn) * np.sin(down), np.cos(down), np.cos(turn) * np.sin(down)], -1)


def _block(u: F64, v: F64) -> F64:
    """A ball pulled into the corners of a cube."""
    d = _ball(u, v)
    return np.asarray(d / np.linalg.norm(d, ord=6, axis=-1, keepdims=True))


def _column(u: F64, v: F64) -> F64:
    turn = 2 * math.pi * u
    reach = np.clip(np.minimum(v, 1 - v) * 6, 1e-3, 1)  # its ends are closed
    height = np.clip((v - 0.5) * 1.5, -0.5, 0.5) * 2
    return np.stack([reach * np.sin(turn) / 2, -height, reach * np.cos(turn) / 2], -1)


def _ring(u: F64, v: F64) -> F64:
    turn, across = 2 * math.pi * u, 2 * math.pi * v
    reach = 0.75 + 0.25 * np.cos(across)
    return np.stack([reach * np.sin(turn), -0.25 * np.sin(across), reach * np.cos(turn)], -1)


def _about(rng: Rng) -> F64:
    """A matrix that turns any way."""
    q, _ = np.linalg.qr(rng.normal(0, 1, (3, 3)))
    m = np.eye(4)
    m[:3, :3] = q * np.sign(np.linalg.det(q))
    return m
