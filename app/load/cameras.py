"""Cameras and lights for scenes that bring none, and a camera that goes around."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from app.load.scene_builder import vector
from app.load.survey import RAYS, Survey
from app.scene import F64, Camera, DirectionalLight, Light, PointLight, Scene

AUTO, ORBIT, CAMERA_FILE = "auto", "orbit", ".json"
_ROOM_FOV, _OBJECT_FOV = 60.0, 40.0
_AZIMUTHS = 24
_OBJECT_VIEW = np.array([0.55, 0.4, 0.73])
_MEAN_IRRADIANCE = 0.5 * math.pi
_SUN_IRRADIANCE = math.pi
_SUN_RADIUS_DEG = 0.27
_UP = np.array([0.0, 1.0, 0.0])


def is_camera_word(name: str) -> bool:
    """Whether ``--camera`` takes ``name`` for something else than a camera of the scene."""
    return name in (AUTO, ORBIT) or name.endswith(CAMERA_FILE)


def auto_camera(scene: Scene) -> Camera:
    """A sensible camera: a room is seen from the inside, an object from outside, three quarters round."""
    return automatic_camera(Survey(scene.meshes, scene.instances))[0]


def orbit(scene: Scene, base: Camera, frames: int) -> list[Camera]:
    """One turn in ``frames`` steps.

    Around an object the eye makes a full circle about the target. In a room it makes a small loop
    around its place, well inside the free space there, so that it never goes through a wall.

    Parameters
    ----------
    scene : Scene
        Where the camera moves.
    base : Camera
        Where it starts, for an object, or the middle of its loop, in a room.
    frames : int
        Number of cameras; the last one is one step before the first.
    """
    survey = Survey(scene.meshes, scene.instances)
    turns = np.arange(frames) * (2 * math.pi / max(frames, 1))
    eye, target, up = (np.asarray(v, np.float64) for v in (base.eye, base.target, base.up))
    if not survey.is_room:
        return [replace(base, eye=vector(target + _turned(eye - target, up, t))) for t in turns]
    forward = target - eye
    right = _unit(np.cross(forward, up))
    above = _unit(np.cross(right, forward))
    radius = min(0.5 * survey.clearance(eye), 0.25 * float(np.linalg.norm(forward)))
    return [replace(base, eye=vector(eye + radius * (math.cos(t) * right + 0.5 * math.sin(t) * above))) for t in turns]


def automatic_camera(survey: Survey) -> tuple[Camera, str]:
    """A camera for a surveyed scene, and a line that says which."""
    if survey.is_room:
        camera = _room_camera(survey)
        return camera, f"no camera given: the room is seen from the inside, from {_place(camera.eye)}"
    center, size = survey.bounds.mean(axis=0), survey.bounds[1] - survey.bounds[0]
    radius = max(float(np.linalg.norm(size)) / 2, 1e-30)
    distance = radius / math.sin(math.radians(_OBJECT_FOV) / 2)
    camera = Camera(vector(center + _unit(_OBJECT_VIEW) * distance), vector(center), fov_y_deg=_OBJECT_FOV)
    return camera, f"no camera given: the object is seen from outside, from {_place(camera.eye)}"


def automatic_light(survey: Survey, camera: Camera) -> tuple[Light, str]:
    """A light for a surveyed scene as ``camera`` sees it, and a line that says which."""
    if survey.is_room:
        lamp = _ceiling_lamp(survey, camera)
        return lamp, f"no light given: a lamp hangs below the ceiling, at {_place(lamp.position)}"
    forward = _unit(np.subtract(camera.target, camera.eye))
    right = _unit(np.cross(forward, camera.up))
    direction = _unit(0.6 * right - 1.0 * np.asarray(camera.up) + 0.5 * forward)
    sun = DirectionalLight(vector(direction), (_SUN_IRRADIANCE,) * 3, _SUN_RADIUS_DEG)
    return sun, "no light given: a sun shines from the upper left"


def _room_camera(survey: Survey) -> Camera:
    """The eye is far from walls, below half height, and looks where most of the room lies before it."""
    points = survey.room_points
    turns = np.arange(_AZIMUTHS) * (2 * math.pi / _AZIMUTHS)
    ways = np.stack([np.cos(turns), np.zeros(_AZIMUTHS), np.sin(turns)], axis=1)
    distance, _ = survey.around(points)
    in_view = np.maximum(RAYS @ ways.T - math.cos(math.radians(_ROOM_FOV / 2 + 10)), 0.0)
    ahead = np.where(np.isfinite(distance), distance, 0.0) @ (in_view / in_view.sum(axis=0))
    comfortable = 0.12 * float((survey.bounds[1] - survey.bounds[0]).max())
    room = np.minimum(distance.min(axis=1), comfortable)
    height = np.clip(1.0 - 2.0 * np.abs(_relative_height(survey, points) - 0.4), 0.1, 1.0)
    score = ahead * (room * height)[:, None]
    place, way = np.unravel_index(int(np.argmax(score)), score.shape)
    target = points[place] + (ways[way] - 0.08 * _UP) * ahead[place, way]
    return Camera(vector(points[place]), vector(target), fov_y_deg=_ROOM_FOV)


def _ceiling_lamp(survey: Survey, camera: Camera) -> PointLight:
    """A small sphere in the upper half of what the camera sees, as far from walls as it can be there."""
    points = survey.room_points
    eye, forward = np.asarray(camera.eye), _unit(np.subtract(camera.target, camera.eye))
    middle = survey.bounds.mean(axis=0)
    focus = eye + forward * max(float((middle - eye) @ forward), 2 * survey.voxel)
    way = focus - points
    length = np.linalg.norm(way, axis=1)
    free, _ = survey.cast(points, way / np.maximum(length, 1e-30)[:, None])
    seen = free >= length - 2 * survey.voxel
    distance = survey.around(points)[0]
    high = np.clip(1.0 - 3.0 * np.abs(_relative_height(survey, points) - 0.75), 0.05, 1.0)
    score = distance.min(axis=1) * high * np.where(seen, 1.0, 0.01) / (length + survey.voxel)
    best = int(np.argmax(score))
    reach = distance[best][np.isfinite(distance[best])]
    intensity = _MEAN_IRRADIANCE * float(np.mean(reach**2))
    radius = min(1.5 * survey.voxel, 0.5 * float(reach.min()))
    return PointLight(vector(points[best]), (intensity,) * 3, radius)


def _relative_height(survey: Survey, points: F64) -> F64:
    """0 on the floor below, 1 at the ceiling above, shape (N,); what is open counts as far as the box goes."""
    up, _ = survey.cast(points, np.tile(_UP, (len(points), 1)))
    down, _ = survey.cast(points, np.tile(-_UP, (len(points), 1)))
    up = np.minimum(up, survey.bounds[1, 1] - points[:, 1])
    down = np.minimum(down, points[:, 1] - survey.bounds[0, 1])
    return np.asarray(down / np.maximum(up + down, 1e-30))


def _place(point: tuple[float, float, float]) -> str:
    return "({:.4g}, {:.4g}, {:.4g})".format(*point)


def _turned(arm: F64, axis: F64, angle: float) -> F64:
    """``arm`` turned about ``axis`` by radians."""
    k = _unit(axis)
    return np.asarray(arm * math.cos(angle) + np.cross(k, arm) * math.sin(angle)
                      + k * float(k @ arm) * (1 - math.cos(angle)))


def _unit(values: F64) -> F64:
    return np.asarray(values / max(float(np.linalg.norm(values)), 1e-300))
