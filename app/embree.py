"""Triangles that Embree intersects with rays, on all cores."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TypeVar

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from app.arrays import F32, Bools, Ints

MIN_RAYS = 1024  # of a thread

Part = TypeVar("Part")


@dataclass(frozen=True, eq=False)
class Intersections:
    """Where N rays meet the nearest triangle.

    Attributes
    ----------
    distance : ndarray, float32, shape (N,)
        In lengths of the direction; where the ray ends, if it meets none.
    triangle : ndarray of int, shape (N,)
        -1 for none.
    u, v : ndarray, float32, shape (N,)
        Barycentric coordinates of the second and third corner.
    area : ndarray, float32, shape (N, 3)
        Normal of the triangle, as long as twice its area.
    """

    distance: F32
    triangle: Ints
    u: F32
    v: F32
    area: F32


class Triangles:
    """Those ``rows`` of all triangles that rays are intersected with.

    Parameters
    ----------
    positions : ndarray, float32, shape (V, 3)
    triangles : ndarray of int, shape (T, 3)
    rows : ndarray of int
        May be empty.
    """

    def __init__(self, positions: F32, triangles: Ints, rows: Ints) -> None:
        self._rows = rows
        if not len(rows):
            return
        self._scene = EmbreeScene()
        triangles = triangles.take(rows, axis=0)
        used = np.zeros(len(positions), np.bool_)
        used[triangles] = True
        number = np.cumsum(used, dtype=np.int32) - 1  # embreex takes long to copy a vertex
        TriangleMesh(self._scene, positions.compress(used, axis=0), number.take(triangles))
        nothing = np.zeros((1, 3), np.float32)
        self._scene.run(nothing, nothing + 1)  # builds the hierarchy, before threads ask for it at once

    def __len__(self) -> int:
        return len(self._rows)

    def intersect(self, origins: F32, directions: F32, ends: F32) -> Intersections:
        """Find the nearest triangle along rays, shape (N, 3), up to their ``ends``, shape (N,), among all triangles."""
        def run(rows: slice) -> dict[str, np.ndarray]:
            hits: dict[str, np.ndarray] = self._scene.run(origins[rows], directions[rows], dists=ends[rows].copy(),
                                                          query="INTERSECT", output=True)
            return hits

        origins, directions = (np.ascontiguousarray(x, np.float32) for x in (origins, directions))
        parts = _on_all_cores(run, len(origins))
        distance, row, *rest = (np.concatenate([part[name] for part in parts])
                                for name in ("tfar", "primID", "u", "v", "Ng"))
        return Intersections(distance, np.where(row < 0, -1, self._rows.take(row, mode="clip")), *rest)

    def meet(self, origins: F32, vectors: F32) -> Bools:
        """Whether any triangle lies on each vector from its origin, both shape (N, 3)."""
        def run(rows: slice) -> Bools:
            hits = self._scene.run(origins[rows], vectors[rows], dists=np.ones(len(origins[rows]), np.float32),
                                   query="OCCLUDED")
            return np.asarray(hits >= 0)

        origins, vectors = (np.ascontiguousarray(x, np.float32) for x in (origins, vectors))
        return np.concatenate(_on_all_cores(run, len(origins)))


def _on_all_cores(run: Callable[[slice], Part], count: int) -> list[Part]:
    """What ``run`` gives for parts of ``count`` rays, in order; embreex releases the GIL while it traces."""
    threads = max(1, min(_cores(), count // MIN_RAYS))
    bounds = np.linspace(0, count, threads + 1).astype(int)
    parts = [slice(*ends) for ends in pairwise(bounds)]
    return [run(parts[0])] if threads == 1 else list(_threads().map(run, parts))


@cache
def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _threads() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(_cores(), "embree")
