"""A coarse voxel grid of a scene, to tell rooms from objects and to find free space."""

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.arrays import F64, Bools
from app.load.geometry import face_vectors
from app.math3d import fibonacci_sphere, unit_rows
from app.scene import Instance, Mesh, bounds_of, key_times_of

_VOXELS = 64                # along the longest edge of the scene's box
_STEP = 0.7                 # of ray marching, in voxels
_SAMPLES_PER_FACE = 8.0     # of a voxel, on surfaces parallel to it
_MAX_SAMPLES = 4e6
_LATTICE = (8, 6, 8)        # free points along x, y and z
_BLOCK = 262_144            # triangles sampled at once
_MIN_BACK_COSINE = 0.3      # between ray and normal, for a hit from behind
_MIN_ENCLOSURE = 0.78       # of a free point that is enclosed by walls,
_MIN_ROOM_SHARE = 0.3       # and share of such points in a room
_MIN_ROOM_ENCLOSURE = 0.55  # of the points that belong to the room
_MIN_BACK_SHARE = 0.05      # of what is seen from outside a room: walls are often modelled from the inside only
_MIN_BUILDING = 8.0         # longest edge in scene units from which on closed walls are those of a building,
_MIN_CABIN = 2.0            # and from which on they are if there is something inside:
_MIN_CONTENTS = 0.01        # share of what is seen from inside that is farther from what is seen from outside
_SHELL = 8                  # than so many voxels
_OUTSIDE = 0.75             # distance of eyes outside the scene, in diagonals of its box
_LOOKS = 1024               # of each of them
_PROJECTED = 16_384         # points at once, on all sides


RAYS = fibonacci_sphere(64)
_SIDES = fibonacci_sphere(256)  # along which points are outermost; by others, within 1 % of their extent


class FreeSpace:
    """A voxel grid that rays march through.

    Parameters
    ----------
    meshes, instances : sequence
        As in a ``Scene``, at time 0.

    Attributes
    ----------
    bounds : ndarray, float64, shape (2, 3)
        World-space box.
    voxel : float
        Edge of a voxel, 1/64 of the longest edge of the box; distances are accurate to about one voxel.
    """

    def __init__(self, meshes: Sequence[Mesh], instances: Sequence[Instance]) -> None:
        self._static = [(meshes[i.mesh], i.transform) for i in instances if not i.moves]
        self._moving = [i for i in instances if i.moves]
        self._meshes = meshes
        self.bounds = bounds_of(tuple(meshes), tuple(instances))
        size = self.bounds[1] - self.bounds[0]
        self.voxel = max(float(size.max()) / _VOXELS, 1e-30)
        self._origin = self.bounds[0] - self.voxel
        self._shape = tuple((np.ceil(size / self.voxel).astype(int) + 2).tolist())
        count: F64 = np.zeros(int(np.prod(self._shape)))
        normal = np.zeros((len(count), 3))
        areas = sum(_area(meshes[i.mesh], i) for i in instances)
        density = min(_SAMPLES_PER_FACE / self.voxel**2, _MAX_SAMPLES / max(areas, 1e-300))
        random = np.random.default_rng(0)
        for instance in instances:
            for points, normals in _sample(meshes[instance.mesh], instance, density, random):
                cell = self._cell(points)
                count += np.bincount(cell, minlength=len(count))
                for axis in range(3):
                    normal[:, axis] += np.bincount(cell, normals[:, axis], minlength=len(count))
        self._solid = count > 0
        self._normal = normal / np.maximum(count, 1)[:, None]

    def cast(self, origins: F64, directions: F64) -> tuple[F64, Bools]:
        """March rays to the first solid voxel.

        Parameters
        ----------
        origins, directions : ndarray, float64, shape (N, 3)
            World space; directions of unit length.

        Returns
        -------
        distance : ndarray, shape (N,)
            In scene units; infinite if the ray leaves the scene's box.
        back : ndarray of bool, shape (N,)
            Whether the surface is hit from behind.
        """
        distance, back = np.full(len(origins), np.inf), np.zeros(len(origins), bool)
        alive = np.arange(len(origins))
        reach = np.linalg.norm(self.bounds[1] - self.bounds[0]) + np.linalg.norm(
            origins - self.bounds.mean(axis=0), axis=1).max(initial=0.0)
        for travelled in np.arange(1.5, reach / self.voxel + 1.0, _STEP) * self.voxel:
            points = origins[alive] + directions[alive] * travelled
            inside = self._inside(points)
            hit = np.zeros(len(alive), bool)
            cell = self._cell(points[inside])
            hit[inside] = self._solid[cell]
            hits = alive[hit]
            distance[hits] = travelled
            facing = np.sum(self._normal[cell[self._solid[cell]]] * directions[hits], axis=1)
            back[hits] = facing > _MIN_BACK_COSINE
            alive = alive[~hit]
            if not len(alive):
                break
        return distance, back

    @cached_property
    def free_points(self) -> F64:
        """A lattice of points in free space inside the box, shape (N, 3)."""
        steps = [(np.arange(n) + 0.5) / n for n in _LATTICE]
        lattice = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
        points = self.bounds[0] + lattice * (self.bounds[1] - self.bounds[0])
        return points[~self._solid[self._cell(points)]]

    @cached_property
    def enclosure(self) -> F64:
        """Share of the directions around each free point that meet the front of a surface, shape (N,)."""
        distance, back = self.around(self.free_points)
        return (np.isfinite(distance) & ~back).mean(axis=1)

    @cached_property
    def is_room(self) -> bool:
        """Whether the scene is to be viewed from the inside: it encloses space, and is not a hollow object."""
        if not len(self.enclosure) or float((self.enclosure >= _MIN_ENCLOSURE).mean()) < _MIN_ROOM_SHARE:
            return False
        longest = float((self.bounds[1] - self.bounds[0]).max())
        if longest >= _MIN_BUILDING:
            return True
        outside, back_share = self._seen_from_outside()
        return back_share >= _MIN_BACK_SHARE or (longest >= _MIN_CABIN and self._contents(outside) >= _MIN_CONTENTS)

    def _seen_from_outside(self) -> tuple[Bools, float]:
        """The voxels that are seen, of the grid's shape, and the share of surfaces that are seen from behind."""
        size = self.bounds[1] - self.bounds[0]
        eyes = np.repeat(self.bounds.mean(axis=0) + _OUTSIDE * float(np.linalg.norm(size)) * RAYS, _LOOKS, axis=0)
        directions = unit_rows(self.bounds[0] + np.random.default_rng(0).random(eyes.shape) * size - eyes)
        distance, back = self.cast(eyes, directions)
        seen, voxels = np.isfinite(distance), np.zeros(self._shape, bool)
        voxels.ravel()[self._cell((eyes + directions * distance[:, None])[seen])] = True
        return voxels, float(back[seen].mean()) if seen.any() else 0.0

    def _contents(self, outside: Bools) -> float:
        """The share of what is seen from inside that is no part of the shell that is seen from ``outside``."""
        shell = outside
        for axis in range(3):
            padded = np.pad(shell, [(_SHELL, _SHELL) if i == axis else (0, 0) for i in range(3)])
            windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _SHELL + 1, axis=axis)
            shell = np.asarray(windows.any(axis=-1))
        points = self.room_points
        distance, _ = self.around(points)
        hit = np.isfinite(distance)
        ends = points[:, None] + RAYS * np.where(hit, distance, 0.0)[..., None]
        return float((~shell.ravel()[self._cell(ends[hit])]).mean()) if hit.any() else 0.0

    @property
    def room_points(self) -> F64:
        """Free points inside a room, openings included, shape (N, 3)."""
        return self.free_points[self.enclosure >= _MIN_ROOM_ENCLOSURE]

    @cached_property
    def _swept(self) -> list[F64]:
        """The outermost points of each instance that moves, over time; only framing needs them, and they take long."""
        return [_outermost(np.concatenate([*_shapes(self._meshes, i)])) for i in self._moving]

    def farthest(self, directions: F64) -> F64:
        """Largest dot product of each direction, shape (N, 3), with a point of the scene at any time, shape (N,).

        Points are vertices; of what moves, the outermost ones over time.
        """
        products = [(points @ directions.T).max(axis=0) for points in self._swept]
        for mesh, matrix in self._static:
            products.append((mesh.positions @ (directions @ matrix[:3, :3]).T).max(axis=0) + directions @ matrix[:3, 3])
        return np.asarray(np.max(products, axis=0))

    def around(self, points: F64) -> tuple[F64, Bools]:
        """``cast`` along all ``RAYS`` from points, shape (N, 3); both results have shape (N, rays)."""
        distance, back = self.cast(np.repeat(points, len(RAYS), axis=0), np.tile(RAYS, (len(points), 1)))
        return distance.reshape(-1, len(RAYS)), back.reshape(-1, len(RAYS))

    def _cell(self, points: F64) -> NDArray[np.intp]:
        index = np.clip(((points - self._origin) / self.voxel).astype(np.intp), 0, np.array(self._shape) - 1)
        return np.ravel_multi_index(tuple(index.T), self._shape)

    def _inside(self, points: F64) -> Bools:
        relative = (points - self._origin) / self.voxel
        return np.asarray(((relative >= 0) & (relative < self._shape)).all(axis=1))


def _area(mesh: Mesh, instance: Instance) -> float:
    scale = abs(float(np.linalg.det(instance.transform_at(0.0)[:3, :3]))) ** (2 / 3)
    faces = face_vectors(mesh.positions.astype(np.float64), mesh.triangles)
    return float(np.linalg.norm(faces, axis=1).sum()) / 2 * scale


def _sample(mesh: Mesh, instance: Instance, density: float, random: np.random.Generator) -> list[tuple[F64, F64]]:
    """Random world-space points and outward unit normals on a mesh, at least one per triangle, in blocks."""
    matrix = instance.transform_at(0.0)
    world = mesh.positions @ matrix[:3, :3].T + matrix[:3, 3]
    blocks = []
    for start in range(0, len(mesh.triangles), _BLOCK):
        triangles = mesh.triangles[start:start + _BLOCK]
        faces = face_vectors(world, triangles)
        double_area = np.linalg.norm(faces, axis=1)
        unit = faces / np.maximum(double_area, 1e-300)[:, None] * _outward_sign(mesh, triangles, matrix)[:, None]
        count = 1 + (double_area * 0.5 * density).astype(np.int64)
        which = np.repeat(np.arange(len(triangles)), count)
        u, v = random.random((2, len(which)))
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        a, b, c = (world[triangles[which, i]] for i in range(3))
        blocks.append((a + u[:, None] * (b - a) + v[:, None] * (c - a), unit[which]))
    return blocks


def _outward_sign(mesh: Mesh, triangles: NDArray[np.uint32], matrix: F64) -> F64:
    """-1 where the winding in world space disagrees with the vertex normals or, if missing, with the file's winding."""
    mirrored = -1.0 if np.linalg.det(matrix[:3, :3]) < 0 else 1.0
    faces = face_vectors(mesh.positions.astype(np.float64), triangles)
    agreement = np.sum(faces * mesh.normals[triangles].sum(axis=1), axis=1)
    return np.where(agreement < 0, -mirrored, mirrored)


def _shapes(meshes: Sequence[Mesh], instance: Instance) -> Iterator[F64]:
    """The outermost vertices of an instance that moves, each of shape (N, 3), in world space.

    At each of its key times, and also between them where it deforms, which need not be linear there.
    """
    mesh, times = meshes[instance.mesh], np.array(key_times_of((instance,)))
    rigid = _outermost(mesh.positions)
    if instance.deformation is not None:
        times = np.union1d(times, (times[1:] + times[:-1]) / 2)
    for time in times.tolist():
        matrix = instance.transform_at(time)
        shape = rigid if instance.deformation is None else _outermost(instance.mesh_at(tuple(meshes), time).positions)
        yield shape @ matrix[:3, :3].T + matrix[:3, 3]


def _outermost(points: NDArray[np.floating[Any]]) -> F64:
    """Those of N points, shape (N, 3), that lie farthest along any of ``_SIDES``; without non-finite ones."""
    chosen: F64 = points[np.isfinite(points).all(axis=1)].astype(np.float64)
    while len(chosen) > len(_SIDES):
        parts = np.array_split(chosen, -(-len(chosen) // _PROJECTED))
        chosen = np.concatenate([part[np.unique((part @ _SIDES.T).argmax(axis=0))] for part in parts])
    return chosen if len(chosen) else np.zeros((1, 3))
