"""Where a drag may turn the eye: never through a surface."""

from __future__ import annotations

import numpy as np
import trimesh

import app.api as afterglow
from app.math3d import axis_angle_matrix
from app.raycast.caster import Caster
from app.scene import Camera
from app.view.orbit import COLUMNS, STEP, Orbit, plan_orbit

ORIGIN = np.zeros(3)


def plan(camera: Camera, pivot: np.ndarray, *meshes: trimesh.Trimesh) -> Orbit | None:
    scene = afterglow.Scene()
    for mesh in meshes:
        scene.add(mesh)
    return plan_orbit(Caster(scene.assemble(()).loaded.scene), camera, pivot)


def slab(size: tuple[float, float, float], at: tuple[float, float, float]) -> trimesh.Trimesh:
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))


def eyes(orbit: Orbit, camera: Camera, pivot: np.ndarray) -> np.ndarray:
    """Corners of all free cells, for a camera that is level and whose up vector is y."""
    forward = np.subtract(camera.target, camera.eye)
    right = np.cross(forward, camera.up) / np.linalg.norm(forward)
    found = []
    for row, cells in enumerate(orbit.free, orbit.first_row):
        for column in (column for column, cell in enumerate(cells) if cell == "1"):
            for pitch, yaw in ((row, column), (row + 1, column), (row, column + 1), (row + 1, column + 1)):
                turn = axis_angle_matrix(np.array([0, yaw * STEP, 0])) @ axis_angle_matrix(pitch * STEP * right)
                found.append(pivot + turn @ np.subtract(camera.eye, pivot))
    return np.array(found)


def test_the_eye_turns_freely_about_an_object_in_the_open() -> None:
    camera = Camera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0))
    orbit = plan(camera, ORIGIN, trimesh.creation.icosphere(radius=1.0))
    assert orbit is not None and set(orbit.free) == {"1" * COLUMNS}
    assert (len(orbit.free), orbit.first_row) == (34, -17)  # up to 85° above and below


def test_it_stays_before_a_wall_and_above_the_ground() -> None:
    camera = Camera((0.0, 0.2, 3.0), (0.0, 0.2, 0.0))
    pivot = np.array([0.0, 0.2, 0.0])
    orbit = plan(camera, pivot, trimesh.creation.icosphere(radius=0.5), slab((20, 20, 0.01), (0, 0, -1.0)),
                 slab((20, 0.01, 20), (0, -0.5, 0)))
    assert orbit is not None
    reached = eyes(orbit, camera, pivot)
    assert reached[:, 2].min() > -1.0 and reached[:, 1].min() > -0.5
    assert reached[:, 2].min() < -0.7 and reached[:, 1].min() < -0.3 and np.ptp(reached[:, 0]) > 5.9


def test_it_does_not_turn_in_a_room() -> None:
    camera = Camera((0.5, 0.0, 1.0), (0.0, 0.0, -2.5))
    assert plan(camera, np.array([0.0, 0.0, -2.5]), trimesh.creation.box((4, 3, 5))) is None


def test_it_does_not_turn_about_a_wall_that_it_would_pass() -> None:
    """Seen at right angles, a flat wall passes exactly through two nodes of the grid."""
    for depth in (1.0, 2.0, 1 / 3):
        camera = Camera((0.0, 0.0, depth), (0.0, 0.0, 0.0))
        assert plan(camera, ORIGIN, trimesh.Trimesh([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]],
                                                    [[0, 1, 2], [0, 2, 3]])) is None


def test_a_camera_that_looks_down_can_still_turn() -> None:
    camera = Camera((0.0, 3.0, 1e-6), (0.0, 0.0, 0.0))
    orbit = plan(camera, ORIGIN, trimesh.creation.icosphere(radius=1.0))
    assert orbit is not None and orbit.first_row + len(orbit.free) >= 0 and set(orbit.free) == {"1" * COLUMNS}
