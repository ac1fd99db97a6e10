"""Connected pieces of a mesh: which triangles hang together, and whether they close a volume."""

from dataclasses import dataclass

import numpy as np

from app.arrays import F64, Bools, Ints
from app.scene import Mesh

WELD_DISTANCE = 1e-6  # of the mesh's size
MAX_OPEN = 0.02       # borders of tiny holes in all, of the longest edge of the piece's box; more leave it open
CELL_OFFSET = 0.37    # keeps regular coordinates away from the borders of cells


@dataclass(frozen=True, eq=False)
class Pieces:
    """The connected pieces of T triangles.

    Attributes
    ----------
    label : ndarray of int, shape (T,)
        The piece of each triangle, counted from 0.
    is_closed : ndarray, bool, shape (pieces,)
        Whether two triangles meet at each edge, but for tiny holes, so that light emitted within does not leave.
    is_inside_out : ndarray, bool, shape (pieces,)
        Of closed pieces, whether the triangles' fronts are within.
    """

    label: Ints
    is_closed: Bools
    is_inside_out: Bools


def find_pieces(mesh: Mesh) -> Pieces:
    """The pieces of a mesh; corners at the same position but for rounding are shared."""
    corners = _weld(mesh.positions.astype(np.float64))[mesh.triangles]
    label = _label_components(corners)
    count = int(label.max()) + 1
    edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2)
    keys = edges[..., 0] * (int(corners.max()) + 1) + edges[..., 1]
    solid = np.flatnonzero((edges[..., 0] != edges[..., 1]).all(axis=1))  # the others have collapsed to a line
    _, edge, meeting = np.unique(keys[solid], return_inverse=True, return_counts=True)
    at = mesh.positions[mesh.triangles].astype(np.float64)
    lengths = np.linalg.norm(at - np.roll(at, -1, axis=1), axis=2)[solid]
    gaps = np.bincount(label[solid], (lengths * (meeting[edge.reshape(-1, 3)] != 2)).sum(axis=1), count)
    low, high = boxes(at, label, count)
    is_closed = gaps <= MAX_OPEN * (high - low).max(axis=1)
    a, b, c = np.moveaxis(at - ((low + high) / 2)[label, None], 1, 0)  # volumes of what has holes depend on the origin
    volume = np.bincount(label, (a * np.cross(b, c)).sum(axis=1), count)
    return Pieces(label, is_closed, is_closed & (volume < 0))


def boxes(corners: F64, label: Ints, count: int) -> tuple[F64, F64]:
    """Lowest and highest corner of each piece's bounding box, shape (count, 3), for corners of shape (T, 3, 3)."""
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, label, corners.min(axis=1))
    np.maximum.at(high, label, corners.max(axis=1))
    return low, high


def _weld(positions: F64) -> Ints:
    """Number of the place of each position, shape (V,)."""
    low, size = positions.min(axis=0), max(float(np.ptp(positions, axis=0).max()), 1e-300)
    cells = np.floor((positions - low) / (WELD_DISTANCE * size) + CELL_OFFSET).astype(np.int64)
    return np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)


def _label_components(corners: Ints) -> Ints:
    """Number of the connected component of each triangle, shape (T,), of welded corners, shape (T, 3)."""
    label = np.arange(int(corners.max()) + 1)
    while True:
        lowest = label[corners].min(axis=1)
        merged = label.copy()
        np.minimum.at(merged, corners.ravel(), np.repeat(lowest, 3))
        merged = merged[merged]
        if np.array_equal(merged, label):
            return np.unique(lowest, return_inverse=True)[1].astype(np.int64)
        label = merged
