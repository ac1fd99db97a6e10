"""Emissive pieces that are flat rectangles, and so rectangle lights."""

import numpy as np

from app.arrays import F64
from app.load.emission_patches import EmissiveTriangles
from app.load.scene_builder import color, vector
from app.scene import RectLight

MIN_POWER_SHARE = 1 / 256   # of all pieces; weaker ones are not tested
MAX_FLATNESS_ERROR = 1e-3   # of the size
MAX_AREA_ERROR = 0.01
MAX_DIRECTIONS = 256        # of a rectangle's edge that are tried, of the longest edges,
SAME_DIRECTION = 1e-4       # and differ by about so much


def find_rectangles(triangles: EmissiveTriangles) -> dict[int, RectLight]:
    """The lights of those pieces that are rectangles, with their mean radiance, by the pieces' numbers."""
    count = int(triangles.piece.max()) + 1
    power = np.bincount(triangles.piece, triangles.power.sum(axis=1), count)
    order = np.argsort(triangles.piece, kind="stable")
    start = np.searchsorted(triangles.piece[order], np.arange(count + 1))
    rectangles = {}
    for number in np.flatnonzero(power >= MIN_POWER_SHARE * power.sum()):
        piece = triangles.select(order[start[number]:start[number + 1]])
        light = _fit_exact_rectangle(piece)
        if light is not None:
            rectangles[int(number)] = light
    return rectangles


def _fit_exact_rectangle(piece: EmissiveTriangles) -> RectLight | None:
    """The rectangle that a piece is; None if it is none."""
    normals = piece.normals
    areas = np.linalg.norm(normals, axis=1)
    area, total = float(areas.sum()), normals.sum(axis=0)
    length = float(np.linalg.norm(total))
    if length <= (1 - MAX_FLATNESS_ERROR) * area:
        return None
    axis = total / length
    center = areas @ piece.corners.mean(axis=1) / area
    points = piece.corners.reshape(-1, 3) - center
    if float(np.abs(points @ axis).max()) > MAX_FLATNESS_ERROR * float(np.linalg.norm(points, axis=1).max()):
        return None
    u, v, middle = _smallest_rectangle(points, axis)
    coverage = min(area / float(np.linalg.norm(u) * np.linalg.norm(v)), 1.0)
    if coverage <= 1 - MAX_AREA_ERROR:
        return None
    radiance = areas @ piece.radiance / area
    return RectLight(vector(center + middle), vector(u), vector(v), color(radiance), bool(piece.two_sided[0]))


def _smallest_rectangle(points: F64, normal: F64) -> tuple[F64, F64, F64]:
    """Edges u and v, with u × v along ``normal``, and centre of the smallest rectangle around planar points.

    One of its sides lies along an edge of the convex hull, so only the directions of triangle edges are tried.
    """
    edges = (points.reshape(-1, 3, 3) - np.roll(points.reshape(-1, 3, 3), 1, axis=1)).reshape(-1, 3)
    edges -= np.outer(edges @ normal, normal)
    length = np.linalg.norm(edges, axis=1)
    order = np.argsort(-length, kind="stable")
    us = edges[order] / np.maximum(length[order, None], 1e-300)
    # A grid has many edges but few directions, of which opposite ones are the same.
    facing = np.abs(us).argmax(axis=1)
    rounded = np.round(us * np.sign(np.take_along_axis(us, facing[:, None], axis=1)) / SAME_DIRECTION)
    us = us[np.sort(np.unique(rounded, axis=0, return_index=True)[1])[:MAX_DIRECTIONS]]
    vs = np.cross(normal, us)
    low, high = np.empty((2, len(us))), np.empty((2, len(us)))
    for row, axes in enumerate((us, vs)):
        for column, axis in enumerate(axes):
            along = points @ axis
            low[row, column], high[row, column] = along.min(), along.max()
    best = int(np.argmin(np.prod(high - low, axis=0)))
    (width, height), (mid_u, mid_v) = (high - low)[:, best], (high + low)[:, best] / 2
    return us[best] * width, vs[best] * height, us[best] * mid_u + vs[best] * mid_v
