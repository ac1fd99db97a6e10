"""Generated scenes with the volumes for their cameras, built of parts."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.arrays import F64
from app.math3d import translation
from app.scene import Camera, CameraPath, Instance, Light, Material, Mesh, Motion, Scene, bounds_of
from app.simple_meshes import rotation_about_y
from export.dataset.scenes.parts import Part, merge

Rng = np.random.Generator
Pieces = list[tuple[Part, Material]]

FRAME_SECONDS = 1 / 30  # between the frames of a pair; moving objects have keyframes at both
CAMERA_MARGIN = 0.2     # metres between cameras and objects
MAX_STEP = 0.06         # metres that an object moves between two frames
MAX_ROTATION = 0.08     # radians
DEFAULT_CAMERA = Camera((0.0, 1.6, 0.0), (0.0, 1.6, -1.0))


@dataclass(frozen=True, eq=False)
class GeneratedScene:
    """A scene with the volumes for its cameras.

    Attributes
    ----------
    camera_volumes : ndarray, float64, shape (K, 2, 3)
        World-space boxes (minimum, maximum) that cameras are placed in.
    blocked_volumes : ndarray, float64, shape (M, 2, 3)
        World-space boxes that no camera is placed in.
    """

    scene: Scene
    camera_volumes: F64
    blocked_volumes: F64

    def random_eye(self, rng: Rng) -> F64:
        """A random camera position, shape (3,)."""
        for _ in range(100):
            low, high = self.camera_volumes[rng.integers(len(self.camera_volumes))]
            eye = rng.uniform(low, high)
            blocked = (eye > self.blocked_volumes[:, 0]) & (eye < self.blocked_volumes[:, 1])
            if not blocked.all(axis=1).any():
                break
        return eye


class GeneratedSceneBuilder:
    """Builds a scene with one mesh per material for static parts, and separate meshes for moving objects.

    Attributes
    ----------
    lights : list of Light
    blocked_volumes : list of ndarray, float64, shape (2, 3)
        Boxes around the objects, with a margin.
    """

    def __init__(self, rng: Rng) -> None:
        self._rng = rng
        self._static: dict[Material, list[Part]] = {}
        self._moving: list[tuple[Pieces, F64, Motion]] = []
        self.lights: list[Light] = []
        self.blocked_volumes: list[F64] = []

    def add(self, part: Part, material: Material) -> None:
        """Add a static part that blocks no cameras, such as a wall: ``build`` gets volumes that exclude it."""
        self._static.setdefault(material, []).append(part)

    def add_object(self, pieces: Pieces, angle: float, at: tuple[float, float, float], moves: bool = False) -> None:
        """Add an object, rotated about y by ``angle`` radians and placed at ``at``; it may move between frames."""
        transform = rotation_about_y(angle, at)
        bounds = merge([part.transformed(transform) for part, _ in pieces]).bounds
        self.blocked_volumes.append(bounds + np.array([[-CAMERA_MARGIN], [CAMERA_MARGIN]]))
        if moves:
            self._moving.append((pieces, transform, self._random_motion(bounds.mean(axis=0))))
        else:
            for part, material in pieces:
                self.add(part.transformed(transform), material)

    def build(self, name: str, camera_volumes: Sequence[object], own_camera: Camera = DEFAULT_CAMERA) -> GeneratedScene:
        """The scene, with cameras in the boxes ``camera_volumes``, each of shape (2, 3), and one of its own."""
        # The names of meshes are part of the scene keys in export/validation/views.json.
        materials = [*self._static, *(m for pieces, _, _ in self._moving for _, m in pieces)]
        meshes = [_mesh(f"still{i}", merge(parts), i) for i, parts in enumerate(self._static.values())]
        instances = [Instance(mesh.name, i, np.eye(4)) for i, mesh in enumerate(meshes)]
        for number, (pieces, transform, motion) in enumerate(self._moving):
            for part, _ in pieces:
                instances.append(Instance(f"thing{number}", len(meshes), transform, motion))
                meshes.append(_mesh(f"thing{number}", part, len(meshes)))
        camera = {"main": CameraPath.still(own_camera)}
        scene = Scene(name, tuple(meshes), tuple(instances), tuple(materials), tuple(self.lights), camera, "main",
                      bounds_of(tuple(meshes), tuple(instances)))
        blocked_volumes = np.array(self.blocked_volumes).reshape(-1, 2, 3)
        return GeneratedScene(scene, np.asarray(camera_volumes, np.float64).reshape(-1, 2, 3), blocked_volumes)

    def _random_motion(self, centre: F64) -> Motion:
        """A small translation and rotation about ``centre`` between the two frames of a pair."""
        rng = self._rng
        step = rng.uniform(-MAX_STEP, MAX_STEP, 3) * (1, 0.3, 1)
        rotation = rotation_about_y(rng.uniform(-MAX_ROTATION, MAX_ROTATION))
        start = translation(centre - step) @ rotation @ translation(-centre)
        return Motion(np.array([0.0, FRAME_SECONDS]), np.stack([start, np.eye(4)]))


def _mesh(name: str, part: Part, material: int) -> Mesh:
    return Mesh(name, part.positions.astype(np.float32), part.normals.astype(np.float32),
                part.triangles.astype(np.uint32), material, uvs=part.uvs.astype(np.float32))
