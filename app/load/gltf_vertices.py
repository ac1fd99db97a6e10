"""The vertices that a glTF primitive uses: primitives can share accessors of which each uses a small part."""

from typing import Any

import numpy as np

from app.arrays import F64, Ints
from app.load.gltf_file import GltfFile


class UsedVertices:
    """Reads attributes of a primitive's V vertices.

    Attributes
    ----------
    order : ndarray of int, shape (K,)
        The vertices in the order in which they form triangles.
    """

    def __init__(self, file: GltfFile, primitive: dict[str, Any]) -> None:
        self._file = file
        self._stored = len(file.accessor(primitive["attributes"]["POSITION"]))
        self._rows: Ints | slice = slice(None)
        self.order: Ints = np.arange(self._stored)
        if "indices" in primitive:
            self.order = file.accessor(primitive["indices"])[:, 0].astype(np.int64)
            if len(self.order) < self._stored and self.order.max(initial=0) < self._stored:
                self._rows, self.order = np.unique(self.order, return_inverse=True)

    def read(self, name: str, accessor: int, *widths: int) -> F64:
        """Values with one of these numbers of components, shape (V, width).

        Raises
        ------
        ValueError
            When there are others, or not one of each vertex; it names ``name``.
        """
        values = self._file.accessor(accessor)
        if len(values) != self._stored or values.shape[1] not in widths:
            raise ValueError(f"{name} has {len(values)} values of {values.shape[1]} components for "
                             f"{self._stored} vertices")
        return values[self._rows].astype(np.float64)
