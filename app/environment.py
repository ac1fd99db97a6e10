"""What an environment sends: its radiance in any direction, and directions that stand for all of its light."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.scene import Environment

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Floats = NDArray[np.floating[Any]]

ORDER = 4          # of spherical harmonics
COARSE = (32, 64)  # rows and columns of the map that light is sampled from, at most
FINE = 4           # texels along a cell, at least
EVENLY = 0.2       # share of the directions that are spread over the whole sphere; the others go where the light is
GOLDEN = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True, eq=False)
class SkyLight:
    """An environment as light: coarse cells, and directions chosen among them.

    Attributes
    ----------
    direction : ndarray, float32, shape (K, 3)
        World space, unit length.
    power : ndarray, float32, shape (K, 3)
        Radiance times the solid angle that each stands for, W/m².
    solid_angle : ndarray, float32, shape (K,)
        That angle, sr.
    cell, cell_power : ndarray, float32, shape (C, 3)
        The same of all cells.
    """

    direction: F32
    power: F32
    solid_angle: F32
    cell: F32
    cell_power: F32

    def irradiance(self, normal: F32, open_to: NDArray[np.bool_]) -> F32:
        """Irradiance / π of points, shape (N, 3), that see the environment along some of the directions.

        Without anything in the way it is exact for the coarse cells; what is hidden is told by the directions alone.

        Parameters
        ----------
        normal : ndarray, float32, shape (N, 3)
        open_to : ndarray of bool, shape (N, K)
        """
        whole = np.maximum(normal @ self.cell.T, 0) @ self.cell_power
        cosine = np.maximum(normal @ self.direction.T, 0)
        chosen, seen = cosine @ self.power, (cosine * open_to) @ self.power
        facing = cosine > 0  # where none of those that face a point has light, any of them tells
        plain = (facing & open_to).sum(axis=1, keepdims=True) / np.maximum(facing.sum(axis=1, keepdims=True), 1)
        share = np.divide(seen, chosen, out=np.broadcast_to(plain, seen.shape).astype(np.float32), where=chosen > 0)
        return np.asarray(whole * share / math.pi, np.float32)


def radiance_along(environment: Environment, direction: F64) -> F32:
    """Radiance, shape (N, 3), from unit directions in world space, shape (N, 3); bilinear, as the shader reads it."""
    h, w = environment.radiance.shape[:2]
    x, y, z = np.asarray(direction, np.float64).T
    u = (np.arctan2(x, -z) / (2 * math.pi) + 0.5 + environment.rotation_deg / 360) * w - 0.5
    v = np.arccos(np.clip(y, -1, 1)) / math.pi * h - 0.5
    left, top = np.floor(u), np.floor(v)
    across, down = (u - left)[:, None], (v - top)[:, None]
    columns = np.stack([left, left + 1]).astype(np.int64) % w
    rows = np.clip(np.stack([top, top + 1]).astype(np.int64), 0, h - 1)
    above, below = (environment.radiance[row[None], columns] for row in rows)
    return np.asarray((1 - down) * ((1 - across) * above[0] + across * above[1])
                      + down * ((1 - across) * below[0] + across * below[1]), np.float32)


def centres(rows: int, columns: int) -> F64:
    """Directions of the texels' centres of a map that is not turned, shape (rows, columns, 3)."""
    polar = (np.arange(rows) + 0.5) * math.pi / rows
    azimuth = ((np.arange(columns) + 0.5) / columns - 0.5) * 2 * math.pi
    sine = np.sin(polar)[:, None]
    return np.stack([sine * np.sin(azimuth), np.broadcast_to(np.cos(polar)[:, None], (rows, columns)),
                     -sine * np.cos(azimuth)], axis=-1)


@lru_cache(maxsize=4)
def sky_light(environment: Environment, count: int) -> SkyLight:
    """``count`` directions among the coarse cells, most of them to where the light comes from.

    As a Fibonacci lattice lies on a sphere (Swinbank and Purser 2006): evenly from row to row, and along them by the
    golden ratio, both after a warp by how often a cell is to be chosen.
    """
    cell, power, angle = _cells(environment)
    light = power.mean(axis=1)
    chance = EVENLY * angle / angle.sum() + (1 - EVENLY) * light / max(float(light.sum()), 1e-300)
    rows = chance.reshape(COARSE)
    row = _index(rows.sum(axis=1)[None], (np.arange(count) + 0.5) / count)
    column = _index(rows[row], np.arange(count) * GOLDEN % 1)
    chosen = row * COARSE[1] + column
    share = 1 / (count * chance[chosen])
    found = cell[chosen], power[chosen] * share[:, None], angle[chosen] * share, cell, power
    return SkyLight(*(np.asarray(x, np.float32) for x in found))


def harmonics(environment: Environment, rotation: F64) -> F32:
    """Coefficients of the radiance, shape (75,): 25 of red, of green, of blue.

    Parameters
    ----------
    rotation : ndarray, float64, shape (3, 3)
        From world space to the space that the harmonics are to be in.
    """
    cell, power, _ = _cells(environment)
    return np.asarray((power.T @ spherical_harmonics(cell @ rotation.T)).ravel(), np.float32)


def spherical_harmonics(direction: F64) -> F64:
    """The 25 real ones to order 4, shape (N, 25), at unit directions, shape (N, 3); the pole is +z.

    Index l (l + 1) + m, as in Sloan 2008, "Stupid Spherical Harmonics (SH) Tricks", but without (-1)^m. The
    associated Legendre polynomials are without their powers of sin θ, which come with the turn about the pole.
    """
    x, y, z = direction.T
    about = (x + 1j * y)[:, None] ** np.arange(ORDER + 1)  # sinᵐθ (cos mφ + i sin mφ)
    found = np.empty((len(direction), (ORDER + 1) ** 2))
    for m in range(ORDER + 1):
        legendre = [np.full_like(z, math.prod(range(1, 2 * m, 2))), (2 * m + 1) * z * math.prod(range(1, 2 * m, 2))]
        for order in range(m + 2, ORDER + 1):
            legendre.append(((2 * order - 1) * z * legendre[-1] - (order + m - 1) * legendre[-2]) / (order - m))
        for order in range(m, ORDER + 1):
            norm = math.sqrt((2 * order + 1) / (4 * math.pi) * math.factorial(order - m) / math.factorial(order + m))
            middle, height = order * (order + 1), norm * math.sqrt(2 if m else 1) * legendre[order - m]
            found[:, middle - m] = height * about[:, m].imag
            found[:, middle + m] = height * about[:, m].real
    return found


@lru_cache(maxsize=4)
def _cells(environment: Environment) -> tuple[F64, F64, F64]:
    """Directions of the coarse cells in world space, radiance times solid angle, both (cells, 3), and solid angles."""
    radiance, (rows, columns) = environment.radiance, COARSE
    h, w = (size * -(-FINE * coarse // size) if size < FINE * coarse else size  # by a whole number, or light is lost
            for coarse, size in zip(COARSE, radiance.shape[:2], strict=True))
    if (h, w) != radiance.shape[:2]:
        radiance = radiance_along(Environment(radiance), centres(h, w).reshape(-1, 3)).reshape(h, w, 3)
    power = radiance * (_bands(h) / w)[:, None, None]
    for axis, (size, coarse) in enumerate(((h, rows), (w, columns))):
        power = np.add.reduceat(power, np.arange(coarse) * size // coarse, axis=axis)
    turn = math.radians(environment.rotation_deg)
    about_y = np.array([[math.cos(turn), 0, math.sin(turn)], [0, 1, 0], [-math.sin(turn), 0, math.cos(turn)]])
    angle = np.repeat(np.add.reduceat(_bands(h), np.arange(rows) * h // rows) / columns, columns)
    return centres(rows, columns).reshape(-1, 3) @ about_y.T, power.reshape(-1, 3), angle


def _index(chances: Floats, at: Floats) -> NDArray[np.int64]:
    """Where the sum of chances, shape (N or 1, K), passes the share ``at``, shape (N,), of its whole; shape (N,)."""
    sums = np.cumsum(chances, axis=1)
    return np.minimum((sums <= at[:, None] * sums[:, -1:]).sum(axis=1), chances.shape[1] - 1)


def _bands(rows: int) -> F64:
    """Solid angle of each row of a latitude-longitude map, sr."""
    edges = np.cos(np.arange(rows + 1) * math.pi / rows)
    return (edges[:-1] - edges[1:]) * 2 * math.pi
