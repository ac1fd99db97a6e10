"""Nodes that move with their parents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from app.animation.latest import Latest
from app.animation.track import Track
from app.arrays import F64, Bools, Ints
from app.math3d import quaternion_matrices, translation

SAMPLES = 8            # times at which the bounds of an animation are looked at
MAX_COORDINATE = 1e18  # beyond which moving things are clamped, so that no pose can make them infinite

Path = Literal["translation", "rotation", "scale"]


@dataclass(frozen=True, eq=False)
class NodeTrack:
    """A track of one property of nodes, of which ``nodes``, shape (M,), are the indices."""

    nodes: Ints
    path: Path
    track: Track


@dataclass(frozen=True, eq=False)
class NodeTree:
    """Nodes with parents, some of them animated.

    Attributes
    ----------
    parents : ndarray of int, shape (N,)
        -1 for roots.
    local : ndarray, float64, shape (N, 4, 4)
        From each node's space to its parent's, at rest.
    translation, rotation, scale : ndarray, float64, shapes (N, 3), (N, 4) and (N, 3)
        The same at rest, of nodes with tracks.
    tracks : tuple of NodeTrack
    period : float
        Seconds, of the longest animation.

    Raises
    ------
    ValueError
        When a node is its own ancestor.
    """

    parents: Ints
    local: F64
    translation: F64
    rotation: F64
    scale: F64
    tracks: tuple[NodeTrack, ...] = ()
    period: float = 0.0

    def __post_init__(self) -> None:
        assert sum(map(len, self._levels)) == len(self.parents)

    @cached_property
    def times(self) -> F64:
        """Seconds, spread evenly over the longest animation, at which bounds are looked at."""
        return np.linspace(0.0, np.nextafter(self.period, 0.0), SAMPLES) if self.period > 0 else np.zeros(1)

    @cached_property
    def moves(self) -> Bools:
        """Whether each node or one of its ancestors has a track, shape (N,)."""
        moves: Bools = np.isin(np.arange(len(self.parents)), self._animated)
        for level in self._levels[1:]:
            moves[level] |= moves[self.parents[level]]
        return moves

    def world_at(self, time: float) -> F64:
        """From each node's space to world space, shape (N, 4, 4), at ``time`` seconds; not to be written to."""
        return self._latest(time)

    @cached_property
    def _latest(self) -> Latest[F64]:
        return Latest(self._evaluate)

    @cached_property
    def _animated(self) -> Ints:
        return np.unique(np.concatenate([np.zeros(0, np.int64), *(t.nodes for t in self.tracks)]))

    @cached_property
    def _levels(self) -> list[Ints]:
        return _levels(self.parents)

    @cached_property
    def _moving_levels(self) -> list[Ints]:
        return [moving for level in self._levels if len(moving := level[self.moves[level]])]

    @cached_property
    def _rest(self) -> F64:
        world = np.empty_like(self.local)
        self._chain(world, self.local, self._levels)
        return world

    def _evaluate(self, time: float) -> F64:
        nodes, local, world = self._animated, self.local.copy(), self._rest.copy()
        at: dict[Path, F64] = {"translation": self.translation.copy(), "rotation": self.rotation.copy(),
                               "scale": self.scale.copy()}
        for track in self.tracks:
            at[track.path][track.nodes] = track.track.at(time)
        local[nodes, :3, :3] = quaternion_matrices(at["rotation"][nodes]) * at["scale"][nodes, None, :]
        local[nodes, :3, 3] = at["translation"][nodes]
        self._chain(world, local, self._moving_levels)
        return np.nan_to_num(world, nan=MAX_COORDINATE).clip(-MAX_COORDINATE, MAX_COORDINATE)

    def _chain(self, world: F64, local: F64, levels: Sequence[Ints]) -> None:
        with np.errstate(over="ignore", invalid="ignore"):
            for level in levels:
                parents = self.parents[level]
                is_root = (parents < 0)[:, None, None]
                world[level] = np.where(is_root, local[level], world[parents] @ local[level])


@dataclass(frozen=True, eq=False)
class NodePlacement:
    """Follows a node of a tree; ``local``, shape (4, 4), leads to the node's space."""

    tree: NodeTree
    node: int
    local: F64

    @property
    def times(self) -> F64:
        """Those of the tree."""
        return self.tree.times

    def shifted(self, offset: F64) -> NodePlacement:
        """The placement of a mesh whose origin is at ``offset``, shape (3,), in this one's object space."""
        return replace(self, local=self.local @ translation(offset))

    def at(self, time: float) -> F64:
        """Object-to-world matrix, shape (4, 4), at ``time`` seconds."""
        return np.asarray(self.tree.world_at(time)[self.node] @ self.local)


def _levels(parents: Ints) -> list[Ints]:
    """Indices of the roots, of their children, and so on."""
    depth = np.where(parents < 0, 0, -1)
    levels = [np.flatnonzero(depth == 0)]
    while len(levels[-1]):
        children = np.flatnonzero((depth < 0) & np.isin(parents, levels[-1]))
        depth[children] = len(levels)
        levels.append(children)
    if (depth < 0).any():
        raise ValueError(f"node {int(np.flatnonzero(depth < 0)[0])} is its own ancestor")
    return levels[:-1]
