"""Cleaning of meshes: finite corners, triangles with an area, and unit or zero normals; their places."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from app.arrays import F64, Bools, Ints
from app.math3d import unit_rows
from app.scene import Instance, Mesh

_MIN_NORMAL_LENGTH = 1e-6
_FLAT_COSINE = 1 - 1e-6  # between the normals of triangles in one plane
_FOLDED_COSINE = -0.99   # of triangles back to back, which have no normal in common
_MAX_COORDINATE = float(np.finfo(np.float32).max)  # larger float64 values would become infinite on the GPU


@dataclass(frozen=True, eq=False)
class RawMesh:
    """Triangles as a file gives them.

    Attributes
    ----------
    positions : ndarray, float64, shape (V, 3)
    triangles : ndarray, int64, shape (T, 3)
    normals, uvs, second_uvs, colors, tangents : ndarray or None
        Shapes (V, 3), (V, 2) with v growing upwards, (V, 2) alike, (V, 4), linear, and (V, 4) as in ``Mesh``.
    source : ndarray of int, shape (V,), or None
        Of a mesh that deforms: the vertex of the file that each one was. Its triangles without an area may gain one.
    """

    positions: F64
    triangles: Ints
    normals: F64 | None = None
    uvs: F64 | None = None
    colors: F64 | None = None
    second_uvs: F64 | None = None
    tangents: F64 | None = None
    source: Ints | None = None


@dataclass(frozen=True, eq=False)
class CleanMesh:
    """A cleaned mesh, and the number of triangles and normals that were removed from it.

    Attributes
    ----------
    normals : ndarray, float64, shape (V, 3)
        Unit length, or zero where the file's are broken or missing.
    source : ndarray of int, shape (V,), or None
        As in ``RawMesh``.
    """

    positions: F64
    triangles: Ints
    normals: F64
    uvs: F64 | None
    colors: F64 | None
    second_uvs: F64 | None
    tangents: F64 | None
    dropped_triangles: int
    dropped_normals: int
    source: Ints | None


def clean(mesh: RawMesh) -> CleanMesh:
    """Drop triangles that can't be drawn and vertices that none uses, and normalise the normals."""
    if mesh.positions.shape[1:] != (3,):
        raise ValueError("a vertex needs three coordinates")
    finite = np.asarray((np.abs(mesh.positions) < _MAX_COORDINATE).all(axis=1))
    triangles = mesh.triangles[finite[mesh.triangles].all(axis=1)]
    if mesh.source is None:
        triangles = triangles[face_vectors(mesh.positions, triangles).any(axis=1)]

    used = np.zeros(len(mesh.positions), bool)
    used[triangles] = True
    renumber = np.cumsum(used) - 1
    normals, dropped_normals = _normalize(mesh.normals[used] if mesh.normals is not None else None, int(used.sum()))
    return CleanMesh(
        positions=mesh.positions[used],
        triangles=renumber[triangles],
        normals=normals,
        uvs=_finite(mesh.uvs, used),
        colors=None if mesh.colors is None else np.clip(np.nan_to_num(mesh.colors[used]), 0.0, 1.0),
        second_uvs=_finite(mesh.second_uvs, used),
        tangents=None if mesh.tangents is None else _unit_tangents(mesh.tangents[used]),
        dropped_triangles=len(mesh.triangles) - len(triangles),
        dropped_normals=dropped_normals,
        source=None if mesh.source is None else mesh.source[used],
    )


def place(mesh: Mesh, instance: Instance) -> F64:
    """Positions of an instance's mesh in world space, shape (V, 3)."""
    return np.asarray(mesh.positions.astype(np.float64) @ instance.transform[:3, :3].T + instance.transform[:3, 3])


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


@np.errstate(over="ignore", invalid="ignore")
def with_creases(meshes: Sequence[RawMesh], groups: Sequence[Ints | None], max_angle: float) -> list[RawMesh]:
    """Meshes with smooth normals across all of them, but for sharp edges.

    A vertex on such an edge becomes one for each side. A mesh that is flat everywhere stays without normals.

    Parameters
    ----------
    groups : sequence of ndarray of int, shape (T,), or None
        The smoothing group of each triangle: edges are smooth within a group and sharp elsewhere, and all edges of 0
        are sharp. None: edges at which triangles meet at more than ``max_angle``, in radians, are sharp.
    """
    if not meshes:
        return []
    whole, starts = join_meshes([RawMesh(m.positions, m.triangles) for m in meshes]), _starts(meshes)
    facing = unit_rows(np.nan_to_num(face_vectors(whole.positions, whole.triangles)))
    group = np.concatenate([np.full(len(m.triangles), -1) if g is None else g
                            for m, g in zip(meshes, groups, strict=True)])
    place = number_rows(whole.positions)
    a, b = _neighbours(place[whole.triangles])
    cosine = np.einsum("ec,ec->e", facing[a], facing[b])
    least = np.where(group[a] < 0, np.cos(max_angle), _FOLDED_COSINE)
    is_smooth = (group[a] == group[b]) & (group[a] != 0) & (cosine >= least)
    part = _components(len(facing), a[is_smooth], b[is_smooth])
    bends = np.zeros(len(facing), bool)
    bends[part[a[is_smooth & (cosine < _FLAT_COSINE)]]] = True
    corners, side = whole.triangles.ravel(), np.repeat(part, 3)
    sides, vertex = np.unique(place[corners] * len(facing) + side, return_inverse=True)
    weighted = np.repeat(facing, 3, axis=0) * _corner_angles(whole.positions, whole.triangles)[:, None]
    normals = np.stack([np.bincount(vertex, weighted[:, axis], len(sides)) for axis in range(3)], axis=1)
    result = []
    for mesh, first, after in zip(meshes, starts, (*starts[1:], len(facing)), strict=True):
        if not bends[part[first:after]].any():
            result.append(mesh)
            continue
        chosen = slice(3 * first, 3 * after)
        key = mesh.triangles.ravel() * len(facing) + side[chosen]
        rows, example, renumber = np.unique(key, return_index=True, return_inverse=True)
        split = take_vertices(mesh, rows // len(facing), renumber.reshape(-1, 3))
        result.append(replace(split, normals=normals[vertex[chosen][example]]))
    return result


def join_meshes(meshes: Sequence[RawMesh]) -> RawMesh:
    """One mesh of all triangles; attributes that not all of them have are lost."""
    offsets = np.cumsum([0, *(len(m.positions) for m in meshes)])
    triangles = np.concatenate([m.triangles + start for m, start in zip(meshes, offsets, strict=False)])
    columns = {f.name: [getattr(m, f.name) for m in meshes] for f in fields(RawMesh) if f.name != "triangles"}
    return RawMesh(triangles=triangles, **{name: np.concatenate(values) for name, values in columns.items()
                                           if all(value is not None for value in values)})


def _starts(meshes: Sequence[RawMesh]) -> list[int]:
    """The number of the first triangle of each mesh among those of all."""
    return [0, *np.cumsum([len(m.triangles) for m in meshes[:-1]]).tolist()]


def take_vertices(mesh: RawMesh, rows: Ints, triangles: Ints) -> RawMesh:
    """The mesh whose vertices are those of ``rows``."""
    arrays = {f.name: getattr(mesh, f.name) for f in fields(mesh) if f.name != "triangles"}
    taken = {name: values[rows] for name, values in arrays.items() if values is not None}
    return replace(mesh, triangles=triangles, **taken)


def number_rows(values: F64) -> Ints:
    """A number for each row that equal rows share, below the number of rows, shape (N,)."""
    rows = np.ascontiguousarray(values + 0.0)  # -0 becomes 0
    opaque = rows.view(np.dtype((np.void, rows.dtype.itemsize * rows.shape[1]))).ravel()
    return np.unique(opaque, return_inverse=True)[1].reshape(-1)


def _corner_angles(positions: F64, triangles: Ints) -> F64:
    """The angle at each corner in radians, shape (3T,)."""
    here = np.nan_to_num(positions[triangles])
    to_next, to_last = (unit_rows((np.roll(here, shift, axis=1) - here).reshape(-1, 3)) for shift in (-1, 1))
    return np.asarray(np.arccos(np.clip(np.einsum("nc,nc->n", to_next, to_last), -1.0, 1.0)))


def _neighbours(corners: Ints) -> tuple[Ints, Ints]:
    """Pairs of triangles that share an edge, by the numbers of their corners, shape (T, 3)."""
    edges = np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    key = edges[:, 0] * (int(corners.max(initial=0)) + 1) + edges[:, 1]
    order = np.argsort(key, kind="stable")
    is_shared = key[order[1:]] == key[order[:-1]]
    return order[:-1][is_shared] // 3, order[1:][is_shared] // 3


def _components(count: int, a: Ints, b: Ints) -> Ints:
    """A number for each of ``count`` things, the same for those that pairs (a, b) join, directly or through others."""
    number = np.arange(count)
    while True:
        least = np.minimum(number[a], number[b])
        joined = number.copy()
        np.minimum.at(joined, number[a], least)
        np.minimum.at(joined, number[b], least)
        while (joined[joined] != joined).any():
            joined = joined[joined]
        if (joined == number).all():
            return number
        number = joined[number]


def add_alpha(colors: F64 | None) -> F64 | None:
    """RGB colours, shape (V, 3), as opaque RGBA, shape (V, 4); RGBA and None are unchanged."""
    if colors is None or colors.shape[1] == 4:
        return colors
    return np.concatenate([colors, np.ones((len(colors), 1))], axis=1)


def _finite(uvs: F64 | None, used: Bools) -> F64 | None:
    return None if uvs is None else np.nan_to_num(uvs[used], posinf=0.0, neginf=0.0)


def _unit_tangents(tangents: F64) -> F64:
    """Unit vectors with a sign; broken ones are zero vectors, with which a normal map has no effect."""
    unit, _ = _normalize(tangents[:, :3], len(tangents))
    return np.column_stack([unit, np.where(tangents[:, 3] < 0, -1.0, 1.0)])


def _normalize(normals: F64 | None, count: int) -> tuple[F64, int]:
    """Unit normals and the number of broken ones; broken or missing normals are zero vectors."""
    if normals is None:
        return np.zeros((count, 3)), 0
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(normals, axis=1)
    valid: Bools = np.isfinite(length) & (length > _MIN_NORMAL_LENGTH)
    unit = np.zeros((count, 3))
    unit[valid] = normals[valid] / length[valid, None]
    return unit, int((~valid).sum())
