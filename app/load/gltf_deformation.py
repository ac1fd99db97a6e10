"""glTF skins and morph targets -> ``Deformation``."""

from __future__ import annotations

from typing import Any

import numpy as np

from app.animation.deformation import Deformation, Skin, Vertices
from app.animation.track import Track
from app.arrays import F64, Ints
from app.errors import SceneError
from app.load.geometry import RawMesh
from app.load.gltf_animation import Poses
from app.load.gltf_file import GltfFile
from app.load.gltf_vertices import UsedVertices
from app.load.scene_builder import MAX_COORDINATE, SceneBuilder

_MAX_VERTICES = 2**24      # of all deformations, counted once for the base and once for each target
_MAX_WEIGHT_ERROR = 0.01   # of the sum of a vertex's skin weights, without a notice


class DeformationReader:
    """Reads what deforms the primitives of one file."""

    def __init__(self, file: GltfFile, builder: SceneBuilder, poses: Poses) -> None:
        self._file, self._builder, self._poses = file, builder, poses
        self._vertices = 0

    def read(self, node: dict[str, Any], index: int, primitive: dict[str, Any], raw: RawMesh,
             used: UsedVertices) -> Deformation:
        """The deformation of a primitive at node ``index``, relative to no origin."""
        specs = primitive.get("targets", [])
        count = len(raw.positions)
        self._vertices += count * (1 + len(specs))
        if self._vertices > _MAX_VERTICES:
            raise SceneError("skins and morph targets have too many vertices", self._builder.where,
                             f"expected at most {_MAX_VERTICES:,}, counted for each target")
        zeros = np.zeros((count, 3))
        attributes = primitive["attributes"]
        base = Vertices(raw.positions, zeros if raw.normals is None else np.nan_to_num(raw.normals),
                        used.read("TANGENT", attributes["TANGENT"], 4) if "TANGENT" in attributes else None)
        targets = tuple(self._target(spec, zeros, base, used) for spec in specs)
        skin = self._skin(node, attributes, used)
        return Deformation(base, targets, self._weights(node, index, len(specs)), skin, self._poses.tree.times)

    def _target(self, spec: dict[str, int], zeros: F64, base: Vertices, used: UsedVertices) -> Vertices:
        if any(name.startswith(("COLOR_", "TEXCOORD_")) for name in spec):
            self._builder.notice("morph targets of colours and texture coordinates are ignored")

        def read(name: str) -> F64:
            return used.read(f"{name} of a morph target", spec[name], 3) if name in spec else zeros

        return Vertices(read("POSITION"), read("NORMAL") if base.normals is not zeros else zeros,
                        None if base.tangents is None else np.pad(read("TANGENT"), ((0, 0), (0, 1))))

    def _weights(self, node: dict[str, Any], index: int, targets: int) -> Track | F64:
        track = self._poses.weights.get(index)
        if track is not None and targets:
            if track.values.shape[-1] != targets:
                raise ValueError(f"an animation has {track.values.shape[-1]} weights for {targets} morph targets")
            return track.at(0.0)[0] if track.is_constant else track
        mesh = self._file.json["meshes"][node["mesh"]]
        weights = np.nan_to_num(np.asarray(node.get("weights", mesh.get("weights", ())), np.float64))
        return np.concatenate([weights, np.zeros(targets)])[:targets]

    def _skin(self, node: dict[str, Any], attributes: dict[str, int], used: UsedVertices) -> Skin | None:
        if "skin" not in node:
            return None
        if "JOINTS_0" not in attributes or "WEIGHTS_0" not in attributes:
            self._builder.notice(f"{node.get('name', 'a mesh')!r} has a skin but no joints, so it is drawn without it")
            return None
        spec, tree = self._file.json["skins"][node["skin"]], self._poses.tree
        nodes = np.asarray(spec["joints"], np.int64)
        if not len(nodes) or not ((nodes >= 0) & (nodes < len(tree.moves))).all():
            raise ValueError(f"skin {node['skin']} has no joints, or one that is missing")
        joints, weights = self._influences(attributes, used)
        if not ((joints >= 0) & (joints < len(nodes))).all():
            raise ValueError(f"a vertex follows a joint that skin {node['skin']} lacks")
        return Skin(tree, nodes, self._inverse_binds(spec, len(nodes)), joints, weights)

    def _influences(self, attributes: dict[str, int], used: UsedVertices) -> tuple[Ints, F64]:
        """The joints of each vertex and its weights, both of shape (V, I)."""
        sets = [k for k in range(len(attributes)) if f"JOINTS_{k}" in attributes and f"WEIGHTS_{k}" in attributes]
        joints, weights = (np.concatenate([used.read(key, attributes[key], 4) for key in keys], axis=1)
                           for keys in ([f"{name}_{k}" for k in sets] for name in ("JOINTS", "WEIGHTS")))
        weights = np.maximum(np.nan_to_num(weights, posinf=0.0), 0.0)
        weights[~weights.any(axis=1), 0] = 1.0
        total = weights.sum(axis=1, keepdims=True)
        if (np.abs(total - 1) > _MAX_WEIGHT_ERROR).any():
            self._builder.notice("the weights of a skin do not add up to 1, so they are scaled")
        return np.where(weights > 0, joints, 0).astype(np.int64), weights / total

    def _inverse_binds(self, spec: dict[str, Any], count: int) -> F64:
        if "inverseBindMatrices" not in spec:
            return np.tile(np.eye(4), (count, 1, 1))
        matrices = self._file.accessor(spec["inverseBindMatrices"]).astype(np.float64)
        if len(matrices) < count or matrices.shape[1] != 16 or not (np.abs(matrices) < MAX_COORDINATE).all():
            raise ValueError(f"a skin lacks finite inverse bind matrices for its {count} joints")
        return matrices[:count].reshape(-1, 4, 4).transpose(0, 2, 1)
