"""Emissive triangles -> emission patches: fewer and small ones, each with the moments of the triangles in it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from app.arrays import F64, Bools, Ints
from app.load.emissive_pieces import boxes

PATCHES = 1024          # that all pieces share by power
MIN_PIECE_PATCHES = 8    # a piece whose share is less is one patch
MAX_PIECE_PATCHES = 256  # roughly; more on curved pieces
MAX_PIECE_CELLS = 256   # across a piece
NORMAL_CELLS = 2.0      # per unit of a normal's components
MIN_FLUX = 0.5          # of the flux that leaves a patch, along its mean normal; below it emits in all directions alike
MIN_ALIGNMENT = 0.7     # as MIN_FLUX, for both directions of a line


@dataclass(frozen=True, eq=False)
class EmissiveTriangles:
    """T triangles in world space that emit.

    Attributes
    ----------
    corners : ndarray, float64, shape (T, 3, 3)
        Counter-clockwise as seen from the front.
    radiance : ndarray, float64, shape (T, 3)
        W/(sr m²).
    two_sided : ndarray, bool, shape (T,)
        Whether the back emits too.
    piece : ndarray of int, shape (T,)
        The connected piece that each belongs to, counted from 0.
    """

    corners: F64
    radiance: F64
    two_sided: Bools
    piece: Ints

    @property
    def normals(self) -> F64:
        """Normals as long as the areas, shape (T, 3)."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return np.asarray(np.cross(b - a, c - a) / 2)

    @property
    def power(self) -> F64:
        """W per channel that leaves each triangle, shape (T, 3)."""
        area = np.linalg.norm(self.normals, axis=1)
        return np.asarray((np.pi * area * (1 + self.two_sided))[:, None] * self.radiance)

    @staticmethod
    def join(parts: "Sequence[EmissiveTriangles]") -> "EmissiveTriangles":
        """The triangles of all parts, in their order."""
        return EmissiveTriangles(*(np.concatenate([getattr(part, field.name) for part in parts])
                                   for field in fields(EmissiveTriangles)))

    def select(self, rows: Ints) -> "EmissiveTriangles":
        return EmissiveTriangles(self.corners[rows], self.radiance[rows], self.two_sided[rows], self.piece[rows])


@dataclass(frozen=True, eq=False)
class Patches:
    """N emission patches.

    Attributes
    ----------
    power : ndarray, float64, shape (N, 3)
        W per channel.
    position : ndarray, float64, shape (N, 3)
        Centroid of the power.
    covariance : ndarray, float64, shape (N, 3, 3)
        Of the emitting points.
    normal : ndarray, float64, shape (N, 3)
        Unit length; zeros where the patch emits in all directions alike.
    two_sided : ndarray, bool, shape (N,)
        Whether a patch with a normal emits to both sides.
    piece : ndarray of int, shape (N,)
    area : ndarray, float64, shape (N,)
        That emits, on both sides if both do.
    """

    power: F64
    position: F64
    covariance: F64
    normal: F64
    two_sided: Bools
    piece: Ints
    area: F64

    @property
    def weight(self) -> F64:
        """Power over all channels, shape (N,)."""
        return np.asarray(self.power.sum(axis=1))


def divide(triangles: EmissiveTriangles, radiance: F64) -> EmissiveTriangles:
    """Parts of triangles as of ``divide_triangle``, of a radiance of shape (T, parts, 3), but for black ones."""
    shares = divide_triangle(math.isqrt(radiance.shape[1]))
    corners = np.einsum("pcs,tsi->tpci", shares, triangles.corners).reshape(-1, 3, 3)
    source = np.repeat(np.arange(len(triangles.corners)), len(shares))
    bright = np.flatnonzero(radiance.reshape(-1, 3).any(axis=1))
    source = source[bright]
    return EmissiveTriangles(corners[bright], radiance.reshape(-1, 3)[bright], triangles.two_sided[source],
                             triangles.piece[source])


def divide_triangle(side: int) -> F64:
    """Barycentric coordinates of the corners of side² equal parts of a triangle, shape (side², 3, 3)."""
    parts = []
    for i in range(side):
        for j in range(side - i):
            parts.append([(i, j), (i + 1, j), (i, j + 1)])
            if i + j < side - 1:
                parts.append([(i + 1, j), (i + 1, j + 1), (i, j + 1)])
    b, c = np.moveaxis(np.array(parts) / side, 2, 0)
    return np.stack([1 - b - c, b, c], axis=2)


def divide_into_patches(triangles: EmissiveTriangles, whole: Bools) -> tuple[EmissiveTriangles, Ints]:
    """Smaller triangles, and the number of the patch of each, which depends on where they are only.

    Parameters
    ----------
    whole : ndarray, bool, shape (pieces,)
        Pieces that must be one patch.
    """
    count = len(whole)
    power = triangles.power.sum(axis=1)
    share = np.bincount(triangles.piece, power, count) / max(float(power.sum()), 1e-300)
    patches = np.where(whole, 1.0, np.clip(PATCHES * share, 1, MAX_PIECE_PATCHES))
    low, high = boxes(triangles.corners, triangles.piece, count)
    area = np.bincount(triangles.piece, np.linalg.norm(triangles.normals, axis=1), count)
    diameter = np.linalg.norm(high - low, axis=1)
    cell = np.maximum(np.sqrt(area / patches), diameter / MAX_PIECE_CELLS)
    cell[patches < MIN_PIECE_PATCHES] = np.inf  # the whole piece
    small = _refine(triangles, cell[triangles.piece])
    return small, _number_cells(small, cell, low)


def _refine(triangles: EmissiveTriangles, max_edge: F64) -> EmissiveTriangles:
    """Bisect the longest edges until none is longer than ``max_edge``, shape (T,)."""
    corners, source = triangles.corners, np.arange(len(triangles.corners))
    while True:
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        rows = np.flatnonzero(edges.max(axis=1) > max_edge[source])
        if len(rows) == 0:
            refined = triangles.select(source)
            return EmissiveTriangles(corners, refined.radiance, refined.two_sided, refined.piece)
        first = edges[rows].argmax(axis=1)
        a, b, c = (corners[rows, (first + i) % 3] for i in range(3))
        middle = (a + b) / 2
        corners = np.concatenate([np.delete(corners, rows, axis=0), np.stack([a, middle, c], 1),
                                  np.stack([middle, b, c], 1)])
        source = np.concatenate([np.delete(source, rows), source[rows], source[rows]])


def _number_cells(triangles: EmissiveTriangles, cell: F64, low: F64) -> Ints:
    """Number of the patch of each triangle, shape (T,): those of one piece, place and direction share one."""
    divided = np.flatnonzero(np.isfinite(cell[triangles.piece]))
    part = triangles.select(divided)
    place = np.floor((part.corners.mean(axis=1) - low[part.piece]) / cell[part.piece, None])
    normals = part.normals
    direction = np.round(NORMAL_CELLS * normals / np.linalg.norm(normals, axis=1, keepdims=True))
    keys = np.concatenate([part.piece[:, None], place, direction], axis=1).astype(np.int64)
    number = triangles.piece.copy()
    number[divided] = len(cell) + np.unique(keys, axis=0, return_inverse=True)[1].reshape(-1)
    return np.unique(number, return_inverse=True)[1].astype(np.int64)


def make_patches(triangles: EmissiveTriangles, patch: Ints) -> Patches:
    """The patches of triangles: one for each number in ``patch``, shape (T,)."""
    power, normals = triangles.power, triangles.normals
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    weight = power.sum(axis=1)
    total = _sum_by(patch, weight[:, None])[:, 0]
    corners = triangles.corners
    position = _sum_by(patch, weight[:, None] * corners.mean(axis=1)) / total[:, None]
    # ∫ x xᵀ over a triangle, about its patch's centroid, divided by the area: (Σ aᵢ aᵢᵀ + s sᵀ) / 12, s = Σ aᵢ
    away = corners - position[patch][:, None]
    middle = away.sum(axis=1)
    second = (np.einsum("tki,tkj->tij", away, away) + np.einsum("ti,tj->tij", middle, middle)) / 12
    covariance = _sum_by(patch, (weight[:, None, None] * second).reshape(-1, 9)).reshape(-1, 3, 3)
    first = np.unique(patch, return_index=True)[1]
    two_sided = triangles.two_sided[first]
    area = _sum_by(patch, ((1 + triangles.two_sided) * np.linalg.norm(normals, axis=1))[:, None])[:, 0]
    return Patches(_sum_by(patch, power), position, covariance / total[:, None, None],
                   _lobes(patch, weight, unit, total, two_sided), two_sided, triangles.piece[first], area)


def _lobes(patch: Ints, weight: F64, unit: F64, total: F64, two_sided: Bools) -> F64:
    """Direction of emission of each patch, see ``Patches.normal``."""
    flux = _sum_by(patch, weight[:, None] * unit) / total[:, None]
    length = np.linalg.norm(flux, axis=1)
    normal = np.where((length > MIN_FLUX)[:, None], flux / np.maximum(length, 1e-300)[:, None], 0.0)
    if two_sided.any():
        outer = np.einsum("t,ti,tj->tij", weight, unit, unit).reshape(-1, 9)
        values, vectors = np.linalg.eigh((_sum_by(patch, outer) / total[:, None]).reshape(-1, 3, 3))
        aligned = (values[:, 2] > MIN_ALIGNMENT)[:, None]
        normal = np.where(two_sided[:, None], np.where(aligned, vectors[:, :, 2], 0.0), normal)
    return np.asarray(normal)


def _sum_by(number: Ints, values: F64) -> F64:
    """Sums of rows with equal numbers, shape (max + 1, C)."""
    return np.stack([np.bincount(number, column) for column in values.T], axis=1)
