"""A strip with two joints and a flag with a morph target, with their shapes in closed form."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.animation.deformation import Deformation, Skin, Vertices
from app.animation.node_tree import NodeTrack, NodeTree
from app.animation.track import Track
from app.math3d import translation
from app.scene import Material, Mesh, Scene, bounds_of
from tests.gl.scenes import Part, make_scene

F64 = NDArray[np.float64]
SEGMENTS = 16
ELBOW = np.array([0.0, 1.0, 0.0])
ANGLE = 1.2       # radians by which the strip's upper joint turns within a second
SECONDS = 1.0
WAVE = 0.6        # by which the target bends the flag at its free end


def strip(material: Material, height: float = 2.0, width: float = 0.3) -> Part:
    """An upright strip in the plane z = 0 whose front faces +z."""
    y = np.linspace(0, height, SEGMENTS + 1)
    a, b = np.stack([0 * y - width / 2, y, 0 * y], 1), np.stack([0 * y + width / 2, y, 0 * y], 1)
    triangles = np.stack([a[:-1], b[:-1], b[1:], a[:-1], b[1:], a[1:]], 1).reshape(-1, 3, 3)
    return Part(triangles, material)


def _weights(positions: F64) -> F64:
    """Of the upper joint."""
    return np.clip((positions[:, 1] - 0.7) / 0.6, 0, 1)


def bent(positions: F64, time: float, angle: float = ANGLE) -> F64:
    """The strip's points at ``time`` seconds up to 1, by hand."""
    turned = angle * time / SECONDS
    rotation = np.array([[np.cos(turned), -np.sin(turned), 0], [np.sin(turned), np.cos(turned), 0], [0, 0, 1]])
    weight = _weights(positions)[:, None]
    return (1 - weight) * positions + weight * ((positions - ELBOW) @ rotation.T + ELBOW)


def waved(positions: F64, time: float) -> F64:
    """The flag's points at ``time`` seconds up to 1, by hand."""
    return positions + (time / SECONDS) * _wave(positions)


def _wave(positions: F64) -> F64:
    """What the target adds."""
    return np.stack([WAVE * positions[:, 1]**2 / 4, 0 * positions[:, 0], WAVE * positions[:, 1] / 2], 1)


def skin_of(positions: F64, angle: float = ANGLE, period: float = 0.0) -> Deformation:
    """Bends the strip about its elbow; back and forth if there is a period."""
    keys = np.array([[0, 0, 0, 1.0], [0, 0, np.sin(angle / 2), np.cos(angle / 2)], [0, 0, 0, 1.0]])
    count = 3 if period else 2
    track = Track(np.arange(count) * SECONDS, keys[:count, None], are_rotations=True, period=period)
    local = np.stack([np.eye(4), translation(ELBOW)])
    tree = NodeTree(np.array([-1, 0]), local, local[:, :3, 3], np.tile([0, 0, 0, 1.0], (2, 1)), np.ones((2, 3)),
                    (NodeTrack(np.array([1]), "rotation", track),), SECONDS)
    binds = np.stack([np.eye(4), translation(-ELBOW)])
    weight = _weights(positions)
    skin = Skin(tree, np.array([0, 1]), binds, np.tile([0, 1], (len(positions), 1)), np.stack([1 - weight, weight], 1))
    return Deformation(Vertices(positions, np.zeros_like(positions)), (), np.zeros(0), skin, tree.times)


def morph_of(positions: F64) -> Deformation:
    """Waves the flag once."""
    weights = Track(np.array([0.0, SECONDS]), np.array([[[0.0]], [[1.0]]]))
    target = Vertices(_wave(positions), np.zeros_like(positions))
    return Deformation(Vertices(positions, np.zeros_like(positions)), (target,), weights, None,
                       np.linspace(0, SECONDS, 5))


@dataclass(frozen=True, eq=False)
class Deforming:
    """A scene whose part ``index`` deforms."""

    scene: Scene
    index: int

    def still(self, positions: F64) -> Scene:
        """The scene in which the part does not move and has other positions."""
        mesh = replace(self.scene.meshes[self.index], positions=positions.astype(np.float32))
        instance = replace(self.scene.instances[self.index], deformation=None)
        return _with(self.scene, self.index, mesh, instance)

    @property
    def positions(self) -> F64:
        return self.scene.meshes[self.index].positions.astype(np.float64)


def deform(scene: Scene, index: int, deformation: Deformation) -> Deforming:
    """Let a part of a scene deform."""
    instance = replace(scene.instances[index], deformation=deformation)
    return Deforming(_with(scene, index, scene.meshes[index], instance), index)


def corners_of(scene: Scene, index: int) -> F64:
    """Vertices of a part, shape (V, 3)."""
    return scene.meshes[index].positions.astype(np.float64)


def material_points(points: F64, triangles: F64, others: F64) -> tuple[F64, NDArray[np.bool_]]:
    """Where points on ``triangles``, shape (T, 3, 3), are on the same triangles ``others``; and whether found."""
    result, found = np.zeros_like(points), np.zeros(len(points), bool)
    for now, then in zip(triangles, others, strict=True):
        edges = np.stack([now[1] - now[0], now[2] - now[0]], axis=1)
        uv, *_ = np.linalg.lstsq(edges, (points - now[0]).T, rcond=None)
        off = np.linalg.norm(points - now[0] - (edges @ uv).T, axis=1)
        inside = (uv.min(axis=0) >= -1e-3) & (uv.sum(axis=0) <= 1 + 1e-3) & (off < 2e-3)
        result[inside] = then[0] + uv[:, inside].T @ np.stack([then[1] - then[0], then[2] - then[0]])
        found |= inside
    return result, found


def _with(scene: Scene, index: int, mesh: Mesh, instance: object) -> Scene:
    meshes, instances = list(scene.meshes), list(scene.instances)
    meshes[index], instances[index] = mesh, instance  # type: ignore[call-overload]
    return replace(scene, meshes=tuple(meshes), instances=tuple(instances),
                   bounds=bounds_of(tuple(meshes), tuple(instances)))


def deforming_scene(kind: str, others: list[Part], *args: object, **more: object) -> Deforming:
    """A strip that a skin bends (``skin``) or a morph target waves (``morph``), then other parts."""
    material = Material(albedo=(0.8, 0.3, 0.2))
    scene = make_scene([strip(material), *others], *args, **more)  # type: ignore[arg-type]
    positions = corners_of(scene, 0)
    return deform(scene, 0, skin_of(positions) if kind == "skin" else morph_of(positions))


SHAPES = {"skin": bent, "morph": waved}
