"""Cameras for scenes that have none, lamps for rooms that have none, and a camera that orbits."""

import math
from dataclasses import replace

import numpy as np

from app.arrays import F64
from app.load.free_space import RAYS, FreeSpace
from app.load.scene_builder import vector
from app.math3d import axis_angle_matrix, look_rotation, normalize
from app.scene import Camera, PointLight, Scene

AUTO, ORBIT, CAMERA_FILE = "auto", "orbit", ".json"
_ROOM_FOV_Y_DEG, _OBJECT_FOV_Y_DEG = 60.0, 40.0
_AZIMUTHS = 24
_OBJECT_VIEW = np.array([0.55, 0.4, 0.73])  # from an object to the eye: before and above it, as the front of glTF is +z
_FILLED = 0.9        # of the picture's width or height that an object fills
_ASPECT = 4 / 3      # of the picture that it is framed for
_HALVINGS = 16
_MEAN_IRRADIANCE = 0.5 * math.pi
_UP = np.array([0.0, 1.0, 0.0])


def is_camera_keyword(name: str) -> bool:
    """Whether ``--camera`` takes ``name`` for a keyword or a file where no camera of the scene has it."""
    return name in (AUTO, ORBIT) or name.endswith(CAMERA_FILE)


def auto_camera(scene: Scene) -> Camera:
    """A default camera: inside a room, or outside an object, in three-quarter view."""
    return place_camera(FreeSpace(scene.meshes, scene.instances))[0]


def orbit(scene: Scene, base: Camera, frames: int) -> list[Camera]:
    """One turn in ``frames`` steps.

    Around an object, the eye moves in a full circle about the target. In a room, it moves in a small loop around its
    position, well inside the free space there, so that it never crosses a wall.

    Parameters
    ----------
    scene : Scene
        The scene that the camera moves in.
    base : Camera
        The first camera, for an object, or the centre of the loop, in a room.
    frames : int
        Number of cameras; the last one is one step before the first.
    """
    space = FreeSpace(scene.meshes, scene.instances)
    angles = np.arange(frames) * (2 * math.pi / max(frames, 1))
    eye, target, up = (np.asarray(v, np.float64) for v in (base.eye, base.target, base.up))
    if not space.is_room:
        axis = normalize(up)
        return [replace(base, eye=vector(target + axis_angle_matrix(a * axis) @ (eye - target))) for a in angles]
    forward = target - eye
    right = normalize(np.cross(forward, up))
    above = normalize(np.cross(right, forward))
    radius = min(0.5 * float(space.around(eye[None])[0].min()), 0.25 * float(np.linalg.norm(forward)))
    return [replace(base, eye=vector(eye + radius * (math.cos(a) * right + 0.5 * math.sin(a) * above))) for a in angles]


def place_camera(space: FreeSpace) -> tuple[Camera, str]:
    """A camera for a scene, and a notice that describes it; what moves stays in the picture."""
    if space.is_room:
        camera = _place_room_camera(space)
        return camera, f"the scene has no camera, so the room is seen from the inside, from {_format(camera.eye)}"
    camera = _frame_object(space)
    return camera, f"the scene has no camera, so the object is seen from outside, from {_format(camera.eye)}"


def place_lamp(space: FreeSpace, camera: Camera) -> tuple[PointLight, str]:
    """A lamp for a room as seen by ``camera``, and where it is in words."""
    lamp = _place_ceiling_lamp(space, camera)
    return lamp, f"a lamp hangs below the ceiling, at {_format(lamp.position)}"


def _frame_object(space: FreeSpace) -> Camera:
    """A camera in three-quarter view whose picture the object fills, from as near as all of it is visible."""
    rotation = look_rotation(-_OBJECT_VIEW, _UP)
    tangent = _FILLED * math.tan(math.radians(_OBJECT_FOV_Y_DEG / 2))
    slopes = tangent * _ASPECT, tangent
    distance = max(_between(space, side, rotation[2], slope)[1] for side, slope in zip(rotation, slopes, strict=False))
    middle = [_middle(space, side, rotation[2], slope, distance)
              for side, slope in zip(rotation, slopes, strict=False)]
    eye = np.array([*middle, distance]) @ rotation
    ahead = max(float((eye - space.bounds.mean(axis=0)) @ rotation[2]), 1e-30)
    return Camera(vector(eye), vector(eye - ahead * rotation[2]), fov_y_deg=_OBJECT_FOV_Y_DEG)


def _between(space: FreeSpace, side: F64, back: F64, slope: float) -> tuple[float, float]:
    """Where along ``side`` and ``back`` an eye is nearest that sees the object between two borders.

    A point (x, z) along them is visible from an eye at (a, c) if |x - a| / slope + z <= c; the largest sums touch the
    borders.
    """
    right, left = space.farthest(np.stack([back + side / slope, back - side / slope])).tolist()
    return slope * (right - left) / 2, (right + left) / 2


def _middle(space: FreeSpace, side: F64, back: F64, slope: float, distance: float) -> float:
    """Where along ``side`` an eye at the ``distance`` along ``back`` sees the object in the middle of the picture."""
    low, high = 0.0, slope
    for _ in range(_HALVINGS):  # of the slope of the narrowest borders
        half = (low + high) / 2
        low, high = (half, high) if _between(space, side, back, half)[1] > distance else (low, half)
    return _between(space, side, back, high)[0]


def _place_room_camera(space: FreeSpace) -> Camera:
    """A camera far from walls, below half height, that looks where the room extends farthest."""
    points = space.room_points
    azimuths = np.arange(_AZIMUTHS) * (2 * math.pi / _AZIMUTHS)
    directions = np.stack([np.cos(azimuths), np.zeros(_AZIMUTHS), np.sin(azimuths)], axis=1)
    distance, _ = space.around(points)
    in_view = np.maximum(RAYS @ directions.T - math.cos(math.radians(_ROOM_FOV_Y_DEG / 2 + 10)), 0.0)
    depth = np.where(np.isfinite(distance), distance, 0.0) @ (in_view / in_view.sum(axis=0))
    max_clearance = 0.12 * float((space.bounds[1] - space.bounds[0]).max())
    clearance = np.minimum(distance.min(axis=1), max_clearance)
    height = np.clip(1.0 - 2.0 * np.abs(_relative_height(space, points) - 0.4), 0.1, 1.0)
    score = depth * (clearance * height)[:, None]
    point, way = np.unravel_index(int(np.argmax(score)), score.shape)
    target = points[point] + (directions[way] - 0.08 * _UP) * depth[point, way]
    return Camera(vector(points[point]), vector(target), fov_y_deg=_ROOM_FOV_Y_DEG)


def _place_ceiling_lamp(space: FreeSpace, camera: Camera) -> PointLight:
    """A small sphere in the upper half of what the camera sees, as far from walls as possible."""
    points = space.room_points
    eye, forward = np.asarray(camera.eye), normalize(np.subtract(camera.target, camera.eye))
    center = space.bounds.mean(axis=0)
    focus = eye + forward * max(float((center - eye) @ forward), 2 * space.voxel)
    to_focus = focus - points
    length = np.linalg.norm(to_focus, axis=1)
    free, _ = space.cast(points, to_focus / np.maximum(length, 1e-30)[:, None])
    visible = free >= length - 2 * space.voxel
    distance = space.around(points)[0]
    height = np.clip(1.0 - 3.0 * np.abs(_relative_height(space, points) - 0.75), 0.05, 1.0)
    score = distance.min(axis=1) * height * np.where(visible, 1.0, 0.01) / (length + space.voxel)
    best = int(np.argmax(score))
    to_walls = distance[best][np.isfinite(distance[best])]
    intensity = _MEAN_IRRADIANCE * float(np.mean(to_walls**2))
    radius = min(1.5 * space.voxel, 0.5 * float(to_walls.min()))
    return PointLight(vector(points[best]), (intensity,) * 3, radius)


def _relative_height(space: FreeSpace, points: F64) -> F64:
    """0 on the floor below, 1 at the ceiling above, shape (N,); the scene's box bounds what is open."""
    up, _ = space.cast(points, np.tile(_UP, (len(points), 1)))
    down, _ = space.cast(points, np.tile(-_UP, (len(points), 1)))
    up = np.minimum(up, space.bounds[1, 1] - points[:, 1])
    down = np.minimum(down, points[:, 1] - space.bounds[0, 1])
    return np.asarray(down / np.maximum(up + down, 1e-30))


def _format(point: tuple[float, float, float]) -> str:
    return "({:.4g}, {:.4g}, {:.4g})".format(*point)
