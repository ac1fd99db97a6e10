"""Points of the emissive surfaces that an approximate light stands for, to which its shadow rays go."""

from collections.abc import Iterator, Sequence

import numpy as np

from app.arrays import F64, Ints
from app.load.emission import spread_over_triangle
from app.load.emission_patches import EmissiveTriangles
from app.scene import EmissionPoints, Light, PointLight, RectLight

POINTS = 2048  # of a light
LEVELS = 6     # at least as many as a tree over the points has
MIN_POWER = 1e-300
FILLED = 0.6, 1.6  # radiance of lights over that of the surfaces, within which these look like the lights


def place_points(triangles: EmissiveTriangles, lights: Sequence[Light],
                 hides_itself: bool = False) -> Iterator[tuple[Light, EmissionPoints]]:
    """Points of ``triangles`` for each of the lights that stand for them together: by its share of their power.

    One for each part of equal power, but more on what faces a direction in which little is sent, such as the narrow
    sides of a panel, which alone light the ceiling around it. Halves of the order, their halves and so on are compact.
    """
    weight = triangles.power.sum(axis=1)
    facing = _main_axis(triangles.normals)
    weight /= np.sqrt(np.maximum(np.bincount(facing, weight), MIN_POWER))[facing]
    row = _choose(triangles, weight)
    position = np.einsum("nk,nkd->nd", spread_over_triangle(POINTS), triangles.corners[row])
    order = _by_halves(position)
    position, row = position[order], row[order]
    normals = triangles.normals[row]
    area = np.linalg.norm(normals, axis=1)
    directions = normals / area[:, None]
    share = weight.sum() / (POINTS * weight[row])  # how often a point stands for its triangle
    area *= share
    is_sparse = _is_sparse(triangles, lights)
    powers = np.maximum([_power(light) for light in lights], MIN_POWER)
    for light, of_all in zip(lights, powers / powers.sum(), strict=True):
        assert isinstance(light, RectLight | PointLight)
        center = light.center if isinstance(light, RectLight) else light.position
        intensity = of_all * area[:, None] * triangles.radiance[row]
        yield light, EmissionPoints((position - center).astype(np.float32), directions.astype(np.float32),
                                    intensity.astype(np.float32), area.astype(np.float32), triangles.two_sided[row],
                                    hides_itself, is_sparse)


def _by_halves(position: F64) -> Ints:
    """An order of points by halves, each along the longest axis of its points."""
    parts = [np.arange(len(position))]
    for _ in range(LEVELS):
        halves = []
        for rows in parts:
            at = position[rows]
            along = at[:, int(np.ptp(at, axis=0).argmax())]
            halves += np.split(rows[np.argsort(along, kind="stable")], [len(rows) // 2])
        parts = halves
    return np.concatenate(parts)


def _is_sparse(triangles: EmissiveTriangles, lights: Sequence[Light]) -> bool:
    """Whether any of the lights is far darker or brighter than the triangles that they stand for."""
    power = triangles.power.sum(axis=1)
    usual = float(power @ triangles.radiance.sum(axis=1)) / max(float(power.sum()), MIN_POWER)
    filled = [_radiance(light) / max(usual, MIN_POWER) for light in lights]
    return not FILLED[0] <= min(filled) <= max(filled) <= FILLED[1]


def _radiance(light: Light) -> float:
    """Summed over channels."""
    if isinstance(light, RectLight):
        return float(np.sum(light.radiance))
    assert isinstance(light, PointLight)
    return float(np.sum(light.intensity)) / max(np.pi * light.radius ** 2, MIN_POWER)


def _main_axis(normals: F64) -> Ints:
    """Which of the six directions along the axes each normal is nearest to."""
    axis = np.abs(normals).argmax(axis=1)
    return 2 * axis + (np.take_along_axis(normals, axis[:, None], axis=1)[:, 0] > 0)


def _power(light: Light) -> float:
    """What a light sends, in a unit that rectangles share; a sphere stands for its pieces alone."""
    if isinstance(light, RectLight):
        return float(np.linalg.norm(np.cross(light.edge_u, light.edge_v)) * np.sum(light.radiance))
    return 1.0


def _choose(triangles: EmissiveTriangles, weight: F64) -> Ints:
    """The triangle of each point: systematic samples of the power, along the longest axis of the triangles."""
    middle = triangles.corners.mean(axis=1)
    away = middle - weight @ middle / weight.sum()
    along = away @ np.linalg.eigh(np.einsum("t,ti,tj->ij", weight, away, away))[1][:, 2]
    order = np.argsort(along, kind="stable")
    sums = np.cumsum(weight[order])
    wanted = (np.arange(POINTS) + 0.5) / POINTS * sums[-1]
    return np.asarray(order[np.minimum(np.searchsorted(sums, wanted), len(order) - 1)])
