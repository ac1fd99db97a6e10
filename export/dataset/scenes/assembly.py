"""Collects parts by material, and makes one scene of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from app.math3d import translation
from app.scene import Camera, CameraPath, Instance, Light, Material, Mesh, Motion, Scene, bounds_of
from export.dataset.scenes.generated_scene import FRAME_SECONDS, GeneratedScene, Rng
from export.dataset.scenes.parts import Part, joined, turned

F64 = NDArray[np.float64]
Piece = tuple[Part, Material]

MARGIN = 0.2         # metres that eyes keep from things
FASTEST = 0.06       # metres that things move between two frames
FASTEST_TURN = 0.08  # radians


class Assembly:
    """Things that stand still become one mesh for each material; things that move get meshes of their own."""

    def __init__(self, rng: Rng) -> None:
        self._rng = rng
        self._materials: dict[Material, list[Part]] = {}
        self._moving: list[tuple[Sequence[Piece], F64, Motion]] = []
        self.lights: list[Light] = []
        self.taken: list[F64] = []

    def add(self, part: Part, material: Material) -> None:
        """Walls, ground and other parts that eyes keep from in another way."""
        self._materials.setdefault(material, []).append(part)

    def put(self, pieces: Sequence[Piece], angle: float, at: tuple[float, float, float], moves: bool = False) -> None:
        """A thing, turned about y by ``angle`` radians and moved by ``at``; it may drift from frame to frame."""
        place = turned(angle, at)
        box = joined([part.moved(place) for part, _ in pieces]).box
        self.taken.append(box + np.array([[-MARGIN], [MARGIN]]))
        if moves:
            self._moving.append((pieces, place, self._drift(box.mean(axis=0))))
        else:
            for part, material in pieces:
                self.add(part.moved(place), material)

    def place(self, name: str, free: Sequence[object]) -> GeneratedScene:
        """The scene, where eyes may be in the boxes ``free``, each of shape (2, 3)."""
        materials = [*self._materials, *(m for pieces, _, _ in self._moving for _, m in pieces)]
        meshes = [_mesh(f"still{i}", joined(parts), i) for i, parts in enumerate(self._materials.values())]
        instances = [Instance(mesh.name, i, np.eye(4)) for i, mesh in enumerate(meshes)]
        for thing, (pieces, at, motion) in enumerate(self._moving):
            for part, _ in pieces:
                instances.append(Instance(f"thing{thing}", len(meshes), at, motion))
                meshes.append(_mesh(f"thing{thing}", part, len(meshes)))
        camera = {"main": CameraPath.still(Camera((0.0, 1.6, 0.0), (0.0, 1.6, -1.0)))}
        scene = Scene(name, tuple(meshes), tuple(instances), tuple(materials), tuple(self.lights), camera, "main",
                      bounds_of(tuple(meshes), tuple(instances)))
        taken = np.array(self.taken).reshape(-1, 2, 3)
        return GeneratedScene(scene, np.asarray(free, np.float64).reshape(-1, 2, 3), taken)

    def _drift(self, middle: F64) -> Motion:
        """A small move and turn about the thing's middle between the two frames of a pair."""
        rng = self._rng
        step = rng.uniform(-FASTEST, FASTEST, 3) * (1, 0.3, 1)
        turn = turned(rng.uniform(-FASTEST_TURN, FASTEST_TURN), (0.0, 0.0, 0.0))
        start = translation(middle - step) @ turn @ translation(-middle)
        return Motion(np.array([0.0, FRAME_SECONDS]), np.stack([start, np.eye(4)]))


def _mesh(name: str, part: Part, material: int) -> Mesh:
    return Mesh(name, part.positions.astype(np.float32), part.normals.astype(np.float32),
                part.triangles.astype(np.uint32), material, uvs=part.uvs.astype(np.float32))
