"""Triangles made safe to draw: no broken corners, no zero areas, unit normals or none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.scene import F64

_MIN_NORMAL = 1e-6
_MAX_FLOAT = float(np.finfo(np.float32).max)  # what the GPU takes for infinite is broken too


@dataclass(frozen=True, eq=False)
class Surface:
    """Raw triangles as a file gives them.

    Attributes
    ----------
    positions : ndarray, float64, shape (V, 3)
    triangles : ndarray, int64, shape (T, 3)
    normals, uvs, colors : ndarray or None
        Shapes (V, 3), (V, 2) with v growing upwards, and (V, 4), linear.
    """

    positions: F64
    triangles: NDArray[np.int64]
    normals: F64 | None = None
    uvs: F64 | None = None
    colors: F64 | None = None


@dataclass(frozen=True, eq=False)
class Cleaned:
    """A surface without flaws, and how many triangles and normals were lost on the way."""

    surface: Surface
    dropped: int
    flattened: int


def clean(surface: Surface) -> Cleaned:
    """Drop triangles that can't be drawn and vertices that nobody uses; make normals unit length or zero."""
    if surface.positions.shape[1:] != (3,):
        raise ValueError("a vertex needs three coordinates")
    triangles = surface.triangles
    finite = np.asarray((np.abs(surface.positions) < _MAX_FLOAT).all(axis=1))
    kept = triangles[finite[triangles].all(axis=1)]
    kept = kept[face_vectors(surface.positions, kept).any(axis=1)]

    used = np.zeros(len(surface.positions), bool)
    used[kept] = True
    renumber = np.cumsum(used) - 1
    normals, flattened = _unit(surface.normals[used] if surface.normals is not None else None, int(used.sum()))
    return Cleaned(
        Surface(
            positions=surface.positions[used],
            triangles=renumber[kept],
            normals=normals,
            uvs=None if surface.uvs is None else np.nan_to_num(surface.uvs[used], posinf=0.0, neginf=0.0),
            colors=None if surface.colors is None else np.clip(np.nan_to_num(surface.colors[used]), 0.0, 1.0),
        ),
        dropped=len(triangles) - len(kept),
        flattened=flattened,
    )


def face_vectors(positions: F64, triangles: NDArray[np.integer]) -> F64:
    """Unnormalised face normals, shape (T, 3); their length is twice the area."""
    a, b, c = (positions[triangles[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def smooth_normals(positions: F64, triangles: NDArray[np.integer]) -> F64:
    """Area-weighted vertex normals, shape (V, 3), not normalised."""
    faces = np.nan_to_num(face_vectors(positions, triangles))
    corners = triangles.ravel()
    sums = [np.bincount(corners, np.repeat(faces[:, axis], 3), len(positions)) for axis in range(3)]
    return np.stack(sums, axis=1)


def _unit(normals: F64 | None, count: int) -> tuple[F64, int]:
    """Unit normals and the number of broken ones; broken or missing normals are zero vectors."""
    if normals is None:
        return np.zeros((count, 3)), 0
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(normals, axis=1)
    fine: NDArray[np.bool_] = np.isfinite(length) & (length > _MIN_NORMAL)
    unit = np.zeros((count, 3))
    unit[fine] = normals[fine] / length[fine, None]
    return unit, int((~fine).sum())
