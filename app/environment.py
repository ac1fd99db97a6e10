"""The radiance of an environment in any direction, and a few directions that represent all of its light."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from app.arrays import F32, F64, Floats, Ints
from app.math3d import GOLDEN_RATIO
from app.scene import Environment

ORDER = 4            # of spherical harmonics
CELLS = (32, 64)     # rows and columns of the map that light is sampled from
CELL_EXTENT = 2 * math.pi / CELLS[1], math.pi / CELLS[0]  # of azimuth and polar angle, radians
STRATA = (128, 256)  # rows and columns of parts of the environment's light
MIN_CELL_TEXELS = 4  # along a cell
SKY_DISTANCE = 100.0  # where rays to the environment end, relative to the scene's longest edge
UNIFORM_SHARE = 0.2  # of the directions, spread over the whole sphere; the others go where the light is


@dataclass(frozen=True, eq=False)
class SkyLight:
    """An environment as light: coarse cells, and directions chosen among them.

    Attributes
    ----------
    direction : ndarray, float32, shape (K, 3)
        World space, unit length.
    power : ndarray, float32, shape (K, 3)
        Radiance times the solid angle that each represents, W/m².
    solid_angle : ndarray, float32, shape (K,)
        That solid angle, sr.
    cell, cell_power : ndarray, float32, shape (C, 3)
        Directions and powers of all cells.
    cell_solid_angle : ndarray, float32, shape (C,)
        In sr.
    """

    direction: F32
    power: F32
    solid_angle: F32
    cell: F32
    cell_power: F32
    cell_solid_angle: F32

    def unoccluded(self, normal: F32) -> F32:
        """Irradiance of points that nothing hides the environment from, shape (N, 3), by their normals, W/m²."""
        return np.asarray(np.maximum(normal @ self.cell.T, 0) @ self.cell_power, np.float32)


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


def texel_directions(rows: int, columns: int) -> F64:
    """Directions of the texel centres of a map without rotation, shape (rows, columns, 3)."""
    polar = (np.arange(rows) + 0.5) * math.pi / rows
    azimuth = ((np.arange(columns) + 0.5) / columns - 0.5) * 2 * math.pi
    sine = np.sin(polar)[:, None]
    return np.stack([sine * np.sin(azimuth), np.broadcast_to(np.cos(polar)[:, None], (rows, columns)),
                     -sine * np.cos(azimuth)], axis=-1)


@lru_cache(maxsize=4)
def sky_light(environment: Environment, count: int) -> SkyLight:
    """``count`` directions among the cells, most of them towards the light.

    They form a Fibonacci lattice (Swinbank and Purser 2006), even from row to row and by the golden ratio along them,
    warped by the probability of each cell.
    """
    cell, power, angle = _cells(environment)
    chance = _light_chance(power, angle)
    rows = chance.reshape(CELLS)
    row = _index(rows.sum(axis=1)[None], (np.arange(count) + 0.5) / count)
    column = _index(rows[row], np.arange(count) * GOLDEN_RATIO % 1)
    chosen = row * CELLS[1] + column
    share = 1 / (count * chance[chosen])
    arrays = cell[chosen], power[chosen] * share[:, None], angle[chosen] * share, cell, power, angle
    return SkyLight(*(np.asarray(x, np.float32) for x in arrays))


@lru_cache(maxsize=4)
def sky_strata(environment: Environment) -> tuple[F32, F32]:
    """The cells that a point of the unit square stands for, if points are spread evenly over the environment's light.

    Each cell has a stratum at least, for what a window shows may be dim beside the rest. The other strata go where the
    light is.

    Returns
    -------
    corner : ndarray, float32, shape (rows, columns, 2)
        Azimuth and polar angle where a stratum's cell begins, radians; its extent is ``CELL_EXTENT``. The direction is
        (sin polar sin azimuth, cos polar, -sin polar cos azimuth) in world space.
    power : ndarray, float32, shape (rows, columns, 3)
        Radiance times the solid angle that each stratum represents, W/m².
    """
    _, power, _ = _cells(environment)
    light = power.mean(axis=1).reshape(CELLS)
    row = np.repeat(np.arange(CELLS[0]), _strata_counts(light.sum(axis=1)[None], STRATA[0])[0])
    column = np.stack([np.repeat(np.arange(CELLS[1]), counts) for counts in _strata_counts(light, STRATA[1])])[row]
    cell = row[:, None] * CELLS[1] + column
    count = np.bincount(cell.ravel(), minlength=len(power))
    azimuth = (column / CELLS[1] - 0.5) * 2 * math.pi - math.radians(environment.rotation_deg)
    corner = np.stack([azimuth, np.broadcast_to(row[:, None], cell.shape) * math.pi / CELLS[0]], axis=-1)
    return np.asarray(corner, np.float32), np.asarray(power[cell] / count[cell][..., None], np.float32)


def sky_points(environment: Environment, at: F32) -> tuple[F32, F32]:
    """Directions in world space that points of the unit square stand for, and their light, as shaders find them.

    Parameters
    ----------
    at : ndarray, float32, shape (N, 2)
        In [0, 1)².

    Returns
    -------
    direction : ndarray, float32, shape (N, 3)
    light : ndarray, float32, shape (N, 3)
        Radiance over the density of evenly spread points, W/m².
    """
    corner, power = sky_strata(environment)
    rows, columns = STRATA
    x, y = at[:, 0] * np.float32(columns), at[:, 1] * np.float32(rows)
    column, row = np.minimum(x.astype(np.int32), columns - 1), np.minimum(y.astype(np.int32), rows - 1)
    stratum = row * columns + column
    start = corner.reshape(-1, 2).take(stratum, axis=0)
    azimuth = start[:, 0] + (x - column) * np.float32(CELL_EXTENT[0])
    polar = start[:, 1] + (y - row) * np.float32(CELL_EXTENT[1])
    direction, sine = np.empty((len(at), 3), np.float32), np.sin(polar)
    direction[:, 0], direction[:, 1], direction[:, 2] = sine * np.sin(azimuth), np.cos(polar), -sine * np.cos(azimuth)
    return direction, power.reshape(-1, 3).take(stratum, axis=0) * np.float32(rows * columns)


def harmonics(environment: Environment, rotation: F64) -> F32:
    """Spherical-harmonic coefficients of the radiance, shape (75,): 25 each for red, green and blue.

    Parameters
    ----------
    rotation : ndarray, float64, shape (3, 3)
        From world space to the space of the harmonics.
    """
    cell, power, _ = _cells(environment)
    return np.asarray((power.T @ spherical_harmonics(cell @ rotation.T)).ravel(), np.float32)


def spherical_harmonics(direction: F64) -> F64:
    """The 25 real spherical harmonics to order 4, shape (N, 25), at unit directions, shape (N, 3); the pole is +z.

    Index l (l + 1) + m, as in Sloan 2008, "Stupid Spherical Harmonics (SH) Tricks", but without (-1)^m. The
    associated Legendre polynomials lack their powers of sin θ, which are factors of the azimuthal part.
    """
    x, y, z = direction.T
    about = (x + 1j * y)[:, None] ** np.arange(ORDER + 1)  # sinᵐθ (cos mφ + i sin mφ)
    values = np.empty((len(direction), (ORDER + 1) ** 2))
    for m in range(ORDER + 1):
        legendre = [np.full_like(z, math.prod(range(1, 2 * m, 2))), (2 * m + 1) * z * math.prod(range(1, 2 * m, 2))]
        for order in range(m + 2, ORDER + 1):
            legendre.append(((2 * order - 1) * z * legendre[-1] - (order + m - 1) * legendre[-2]) / (order - m))
        for order in range(m, ORDER + 1):
            norm = math.sqrt((2 * order + 1) / (4 * math.pi) * math.factorial(order - m) / math.factorial(order + m))
            middle, height = order * (order + 1), norm * math.sqrt(2 if m else 1) * legendre[order - m]
            values[:, middle - m] = height * about[:, m].imag
            values[:, middle + m] = height * about[:, m].real
    return values


@lru_cache(maxsize=4)
def _cells(environment: Environment) -> tuple[F64, F64, F64]:
    """Directions of the cells in world space, radiance times solid angle, both (cells, 3), and solid angles."""
    radiance, (rows, columns) = environment.radiance, CELLS
    # A map that is too small is enlarged by a whole number, or light would be lost.
    h, w = (size * -(-MIN_CELL_TEXELS * cells // size) if size < MIN_CELL_TEXELS * cells else size
            for cells, size in zip(CELLS, radiance.shape[:2], strict=True))
    if (h, w) != radiance.shape[:2]:
        radiance = radiance_along(Environment(radiance), texel_directions(h, w).reshape(-1, 3)).reshape(h, w, 3)
    power = radiance * (row_solid_angles(h) / w)[:, None, None]
    for axis, (size, coarse) in enumerate(((h, rows), (w, columns))):
        power = np.add.reduceat(power, np.arange(coarse) * size // coarse, axis=axis)
    angle_y = math.radians(environment.rotation_deg)
    cosine, sine = math.cos(angle_y), math.sin(angle_y)
    about_y = np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
    angle = np.repeat(np.add.reduceat(row_solid_angles(h), np.arange(rows) * h // rows) / columns, columns)
    return texel_directions(rows, columns).reshape(-1, 3) @ about_y.T, power.reshape(-1, 3), angle


def _light_chance(power: F64, angle: F64) -> F64:
    """Probability of each cell, shape (cells,): mostly by its light, partly by its solid angle."""
    light = power.mean(axis=1)
    return UNIFORM_SHARE * angle / angle.sum() + (1 - UNIFORM_SHARE) * light / max(float(light.sum()), 1e-300)


def _index(chances: Floats, at: Floats) -> Ints:
    """Where the running sum of ``chances``, (N or 1, K), exceeds the share ``at``, (N,), of its total; shape (N,)."""
    sums = np.cumsum(chances, axis=1)
    return np.minimum((sums <= at[:, None] * sums[:, -1:]).sum(axis=1), chances.shape[1] - 1)


def _strata_counts(light: F64, total: int) -> Ints:
    """Whole numbers from 1 on whose rows sum to ``total``; beyond 1, in proportion to ``light``, shape (N, K)."""
    sums = np.cumsum(light + max(float(light.max()), 1e-300) * 1e-12, axis=1)
    bounds = np.rint(sums / sums[:, -1:] * (total - light.shape[1])).astype(np.int64)
    return np.diff(bounds, axis=1, prepend=0) + 1


def row_solid_angles(rows: int) -> F64:
    """Solid angle of each row of a latitude-longitude map, sr."""
    edges = np.cos(np.arange(rows + 1) * math.pi / rows)
    return (edges[:-1] - edges[1:]) * 2 * math.pi
