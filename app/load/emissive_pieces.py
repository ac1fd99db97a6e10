"""Connected pieces of a mesh: which triangles hang together, and whether they close a volume."""

from dataclasses import dataclass

import numpy as np

from app.arrays import Bools, Ints
from app.scene import Mesh


@dataclass(frozen=True, eq=False)
class Pieces:
    """The connected pieces of T triangles.

    Attributes
    ----------
    label : ndarray of int, shape (T,)
        The piece of each triangle, counted from 0.
    is_closed : ndarray, bool, shape (pieces,)
        Whether exactly two triangles meet at each edge, so that light emitted within does not leave.
    is_inside_out : ndarray, bool, shape (pieces,)
        Of closed pieces, whether the triangles' fronts are within.
    """

    label: Ints
    is_closed: Bools
    is_inside_out: Bools


def find_pieces(mesh: Mesh) -> Pieces:
    """The pieces of a mesh; corners at the same position are shared."""
    _, weld = np.unique(mesh.positions, axis=0, return_inverse=True)
    corners = weld.reshape(-1)[mesh.triangles].astype(np.int64)
    label = _label_components(corners)
    count = int(label.max()) + 1
    edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2)
    keys = edges[..., 0] * (int(corners.max()) + 1) + edges[..., 1]
    _, edge, meeting = np.unique(keys, return_inverse=True, return_counts=True)
    is_open = (meeting[edge.reshape(keys.shape)] != 2).any(axis=1)
    a, b, c = np.moveaxis(mesh.positions[mesh.triangles].astype(np.float64), 1, 0)
    volume = np.bincount(label, (a * np.cross(b, c)).sum(axis=1), count)
    is_closed = np.bincount(label, is_open, count) == 0
    return Pieces(label, is_closed, is_closed & (volume < 0))


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
