"""Vertices that move: morph targets and skins."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from app.animation.latest import Latest
from app.animation.node_tree import MAX_COORDINATE, NodeTree
from app.animation.track import Track
from app.arrays import F32, F64, Bools, Ints
from app.math3d import unit_rows
from app.scene import Shape


@dataclass(frozen=True, eq=False)
class Vertices:
    """Positions, shape (V, 3), normals, shape (V, 3), and tangents, shape (V, 4), or what is added to them.

    Without normals all are zero vectors; ``tangents`` may be None.
    """

    positions: F64
    normals: F64
    tangents: F64 | None = None

    def select(self, rows: Ints) -> Vertices:
        """The vertices at an index."""
        return Vertices(self.positions[rows], self.normals[rows],
                        None if self.tangents is None else self.tangents[rows])


@dataclass(frozen=True, eq=False)
class Skin:
    """Joints that move vertices.

    Attributes
    ----------
    nodes : ndarray of int, shape (J,)
        The node of each joint in ``tree``.
    inverse_binds : ndarray, float64, shape (J, 4, 4)
        From the space of the vertices to each joint's.
    joints : ndarray of int, shape (V, I)
        The joints that each vertex follows,
    weights : ndarray, float64, shape (V, I)
        and its shares in them, whose sum is 1.
    """

    tree: NodeTree
    nodes: Ints
    inverse_binds: F64
    joints: Ints
    weights: F64

    @property
    def moves(self) -> bool:
        return bool(self.tree.moves[self.nodes].any())

    def is_mirrored(self, time: float) -> Bools:
        """Which vertices the joints mirror at ``time`` seconds, shape (V,)."""
        return np.asarray(np.linalg.det(self._blend(time)[:, :, :3]) < 0)

    def select(self, rows: Ints) -> Skin:
        """The skin of the vertices at an index."""
        return Skin(self.tree, self.nodes, self.inverse_binds, self.joints[rows], self.weights[rows])

    def apply(self, vertices: Vertices, time: float) -> Vertices:
        """The vertices in world space at ``time`` seconds."""
        blended = self._blend(time)
        linear = blended[:, :, :3]
        cofactors = _cofactors(linear)
        determinant = (linear[:, :, 0] * cofactors[:, :, 0]).sum(axis=1)
        sign = np.where(determinant < 0, -1.0, 1.0)[:, None]  # what is mirrored keeps its front
        tangents = vertices.tangents
        if tangents is not None:
            tangents = np.concatenate([_apply(linear, tangents[:, :3]), sign * tangents[:, 3:]], axis=1)
        return Vertices(_apply(linear, vertices.positions) + blended[:, :, 3],
                        sign * _apply(cofactors, vertices.normals), tangents)

    def _blend(self, time: float) -> F64:
        """The matrix of each vertex, shape (V, 3, 4)."""
        matrices = (self.tree.world_at(time)[self.nodes] @ self.inverse_binds)[:, :3]
        blended = np.zeros((len(self.joints), 3, 4))
        for joint, weight in zip(self.joints.T, self.weights.T, strict=True):
            blended += weight[:, None, None] * matrices[joint]
        return blended


@dataclass(frozen=True, eq=False)
class Deformation:
    """Vertices at any time: first their morph targets are added to them, then joints move them.

    Attributes
    ----------
    base : Vertices
    targets : tuple of Vertices
        What each morph target adds at weight 1.
    weights : Track or ndarray, float64, shape (T,)
        Of the targets; a track of one vector.
    skin : Skin or None
        With a skin the result is in world space, otherwise in the space of ``base``.
    times : ndarray, float64, shape (S,)
        Seconds at which bounds are looked at.
    origin : ndarray, float64, shape (3,)
        What results are relative to.
    """

    base: Vertices
    targets: tuple[Vertices, ...]
    weights: Track | F64
    skin: Skin | None
    times: F64
    origin: F64 = field(default_factory=lambda: np.zeros(3))

    @property
    def moves(self) -> bool:
        """Whether any time changes anything."""
        return isinstance(self.weights, Track) or (self.skin is not None and self.skin.moves)

    def select(self, rows: Ints, origin: F64) -> Deformation:
        """That of the vertices at an index, relative to ``origin``, shape (3,)."""
        return Deformation(self.base.select(rows), tuple(t.select(rows) for t in self.targets), self.weights,
                           None if self.skin is None else self.skin.select(rows), self.times, origin)

    def with_tangents(self, tangents: F64 | None) -> Deformation:
        """The same with other tangents of ``base``, shape (V, 4)."""
        return replace(self, base=replace(self.base, tangents=tangents))

    def at(self, time: float) -> Shape:
        """The shape at ``time`` seconds."""
        return self._latest(time)

    @cached_property
    def _latest(self) -> Latest[Shape]:
        return Latest(self._evaluate)

    def _evaluate(self, time: float) -> Shape:
        return _finish(self.vertices_at(time), self.origin)

    def vertices_at(self, time: float) -> Vertices:
        """The vertices at ``time`` seconds, with normals and tangents of any length, relative to no origin."""
        weights = self.weights.at(time)[0] if isinstance(self.weights, Track) else self.weights
        positions, normals, tangents = self.base.positions, self.base.normals, self.base.tangents
        for weight, target in zip(weights, self.targets, strict=True):
            if weight != 0:
                positions, normals = positions + weight * target.positions, normals + weight * target.normals
                if tangents is not None and target.tangents is not None:
                    tangents = tangents + weight * target.tangents
        morphed = Vertices(positions, normals, tangents)
        return morphed if self.skin is None else self.skin.apply(morphed, time)


def _finish(vertices: Vertices, origin: F64) -> Shape:
    positions = np.nan_to_num(vertices.positions).clip(-MAX_COORDINATE, MAX_COORDINATE) - origin
    return Shape(positions.astype(np.float32), _unit(vertices.normals).astype(np.float32),
                 None if vertices.tangents is None else _unit_tangents(vertices.tangents))


def _unit_tangents(tangents: F64) -> F32:
    return np.concatenate([_unit(tangents[:, :3]), tangents[:, 3:]], axis=1).astype(np.float32)


def _unit(vectors: F64) -> F64:
    """Unit vectors; zero vectors stay zero, and NaN becomes zero."""
    return unit_rows(np.nan_to_num(vectors))


def _apply(matrices: F64, vectors: F64) -> F64:
    """Each matrix, shape (V, 3, 3), times its vector, shape (V, 3)."""
    return np.asarray((matrices @ vectors[:, :, None])[..., 0])


def _cofactors(matrices: F64) -> F64:
    """Cofactor matrices, shape (V, 3, 3), which transform normals."""
    x, y, z = np.moveaxis(matrices, 2, 0)  # columns
    return np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=2)
