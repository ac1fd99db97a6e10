"""glTF animations and nodes -> ``NodeTree``, and tracks of morph weights."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from app.animation.node_tree import NodeTrack, NodeTree, Path
from app.animation.track import Interpolation, Track
from app.arrays import F64
from app.errors import SceneError, did_you_mean
from app.load.gltf_file import GltfFile
from app.load.scene_builder import ALL_ANIMATIONS, MAX_COORDINATE, NO_ANIMATION, SceneBuilder
from app.math3d import affine_matrix, quaternion_matrices

_WIDTHS: dict[Path, int] = {"translation": 3, "rotation": 4, "scale": 3}
_REST: dict[Path, tuple[float, ...]] = {"translation": (0, 0, 0), "rotation": (0, 0, 0, 1), "scale": (1, 1, 1)}
_WEIGHTS = "weights"


@dataclass(frozen=True, eq=False)
class Poses:
    """What the chosen animations move: the file's nodes, and the morph weights of some of them."""

    tree: NodeTree
    weights: dict[int, Track]
    period: float  # seconds, of the longest animation


def local_matrix(node: dict[str, Any]) -> F64:
    """From a node's space to its parent's at rest, shape (4, 4)."""
    if "matrix" in node:
        return np.asarray(node["matrix"], np.float64).reshape(4, 4).T
    rotation = quaternion_matrices(np.asarray([node.get("rotation", _REST["rotation"])], np.float64))[0]
    scale = np.asarray(node.get("scale", _REST["scale"]), np.float64)
    return affine_matrix(rotation * scale, node.get("translation", _REST["translation"]))


def read_poses(file: GltfFile, builder: SceneBuilder) -> Poses:
    """Read the animations that ``builder.animation`` chooses.

    Raises
    ------
    SceneError
        When the file has no animation of that name.
    ValueError
        When keys are not finite or not in order, or a node is its own ancestor.
    """
    nodes = file.items("nodes")
    reader = _TrackReader(file, builder, nodes)
    period = max([0.0, *(reader.read(animation) for animation in _choose(file, builder))])
    parents = np.full(len(nodes), -1, np.int64)
    for index, node in enumerate(nodes):
        for child in node.get("children", []):
            if not 0 <= child < len(nodes) or parents[child] >= 0:
                raise ValueError(f"node {child} is missing or has two parents")
            parents[child] = index
    rest = {path: np.array([node.get(path, _REST[path]) for node in nodes], np.float64).reshape(-1, _WIDTHS[path])
            for path in _WIDTHS}
    local = np.array([local_matrix(node) for node in nodes]).reshape(-1, 4, 4)
    for (index, path), track in reader.constant.items():
        rest[path][index] = track.at(0.0)[0]
        local[index] = affine_matrix(quaternion_matrices(rest["rotation"][index, None])[0] * rest["scale"][index],
                                     rest["translation"][index])
    if period == 0 and (reader.merged() or not all(track.is_constant for track in reader.weights.values())):
        builder.notice("the animation has no key after 0 s, so it stands still")
    tree = NodeTree(parents, local, **rest, tracks=reader.merged(), period=period)
    return Poses(tree, reader.weights, period)


def _choose(file: GltfFile, builder: SceneBuilder) -> list[dict[str, Any]]:
    animations = file.items("animations")
    builder.animations = [a.get("name") or f"animation {i}" for i, a in enumerate(animations)]
    name = builder.animation
    if name is None:
        return animations[:1]
    if name in builder.animations:
        return [animations[builder.animations.index(name)]]
    if name == ALL_ANIMATIONS:
        return animations
    if name != NO_ANIMATION and animations:
        raise SceneError(f"no animation {name!r}", builder.where, did_you_mean(
            name, (*builder.animations, ALL_ANIMATIONS, NO_ANIMATION)))
    return []


@dataclass
class _TrackReader:
    """Collects tracks; a later one replaces an earlier one of the same property."""

    file: GltfFile
    builder: SceneBuilder
    nodes: list[dict[str, Any]]
    weights: dict[int, Track] = field(default_factory=dict)
    constant: dict[tuple[int, Path], Track] = field(default_factory=dict)
    _moving: dict[tuple[int, Path], tuple[tuple[Any, ...], Track]] = field(default_factory=dict)

    def read(self, animation: dict[str, Any]) -> float:
        """Read the channels of an animation; returns its length in seconds."""
        samplers = animation.get("samplers", [])
        times = [self._times(sampler["input"]) for sampler in samplers]
        period = max((float(t[-1]) for t in times), default=0.0)
        for channel in animation.get("channels", []):
            target, number = channel["target"], channel["sampler"]
            path = target["path"]
            if path == "pointer":
                self.builder.notice("animated properties that are not a node's transform or morph weights "
                                    "(KHR_animation_pointer) are ignored")
                continue
            index = target.get("node")
            if index is None:
                continue
            if not 0 <= index < len(self.nodes) or not 0 <= number < len(samplers):
                raise IndexError("an animation refers to a missing node or sampler")
            if path == _WEIGHTS:
                self.weights[index] = self._track(samplers[number], times[number], None, period)
            elif path not in _WIDTHS:
                raise ValueError(f"unknown animated property {path!r}")
            elif "matrix" in self.nodes[index]:
                self.builder.notice(f"the animation of node {index} is ignored, since it has a matrix")
            else:
                self._add(index, path, samplers[number], self._track(samplers[number], times[number], path, period))
        return period

    def merged(self) -> tuple[NodeTrack, ...]:
        """The tracks of nodes, those with the same keys as one."""
        groups: dict[tuple[Any, ...], list[tuple[int, Path, Track]]] = {}
        for (index, path), (key, track) in self._moving.items():
            groups.setdefault(key, []).append((index, path, track))
        merged = []
        for group in groups.values():
            _, path, first = group[0]
            values = np.concatenate([track.values for _, _, track in group], axis=-2)
            track = Track(first.times, values, first.interpolation, first.are_rotations, first.period)
            merged.append(NodeTrack(np.array([index for index, _, _ in group]), path, track))
        return tuple(merged)

    def _add(self, index: int, path: Path, sampler: dict[str, Any], track: Track) -> None:
        self.constant.pop((index, path), None)
        self._moving.pop((index, path), None)
        if track.is_constant:
            self.constant[index, path] = track
        else:
            self._moving[index, path] = (path, sampler["input"], track.interpolation, track.period), track

    def _times(self, accessor: int) -> F64:
        times = self.file.accessor(accessor)[:, 0].astype(np.float64)
        if not len(times) or not np.isfinite(times).all() or (np.diff(times) < 0).any():
            raise ValueError("the times of an animation are missing, not finite or not in order")
        return times

    def _track(self, sampler: dict[str, Any], times: F64, path: Path | None, period: float) -> Track:
        """A track of a node's ``path``, or of morph weights."""
        interpolation = Interpolation(sampler.get("interpolation", "LINEAR"))
        values = self.file.accessor(sampler["output"]).astype(np.float64)
        spline = (3,) if interpolation is Interpolation.CUBICSPLINE else ()
        keys = len(times) * max(len(spline) * 3, 1)
        width = values.size // keys if path is None else _WIDTHS[path]
        if width == 0 or values.size != keys * width:
            raise ValueError(f"an animation has {len(values)} values for {len(times)} keys")
        if not (np.abs(values) < MAX_COORDINATE).all():
            raise ValueError("the keys of an animation are too large or not finite")
        values = values.reshape(len(times), *spline, 1, width)
        if path == "rotation" and not spline:
            length = np.linalg.norm(values, axis=-1, keepdims=True)
            values = np.where(length > 0, values / np.where(length > 0, length, 1), _REST["rotation"])
        return Track(times, values, interpolation, path == "rotation", period)
