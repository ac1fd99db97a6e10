"""Cameras from matrices agree with the projections of OpenCV and OpenGL."""

from __future__ import annotations

import numpy as np
import pytest

import app.api as afterglow
from app.errors import SceneError
from app.math3d import View, axis_angle_matrix

SIZE = (64, 48)
K = np.array([[70.0, 0, 30.5], [0, 65.0, 25.0], [0, 0, 1]])
POINT = np.array([0.4, -0.3, -5.0])  # in world space


def pose() -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = axis_angle_matrix(np.array([0.1, 0.2, -0.3]))
    matrix[:3, 3] = 0.5, 0.1, 0.2
    return matrix


def pixel_of(camera: afterglow.Camera) -> np.ndarray:
    """Where ``POINT`` is seen, x and y down, with integers in the middle of pixels."""
    view = View.of(camera, SIZE, 1e-3)
    clip = view.clip_from_relative() @ np.append(POINT - view.eye, 1.0)
    return (clip[:2] / clip[3] * (1, -1) + 1) * SIZE / 2 - 0.5


def test_opencv_camera_projects_as_opencv() -> None:
    matrix = pose() @ np.diag([1.0, -1.0, -1.0, 1.0])
    projected = K @ (np.linalg.inv(matrix) @ np.append(POINT, 1.0))[:3]
    camera = afterglow.camera_from_matrix(matrix, K, SIZE, convention="opencv")
    assert np.allclose(pixel_of(camera), projected[:2] / projected[2], atol=1e-9)


def test_conventions_differ_by_the_axes_alone() -> None:
    opencv = afterglow.camera_from_matrix(pose() @ np.diag([1.0, -1.0, -1.0, 1.0]), K, SIZE, convention="opencv")
    assert np.allclose(pixel_of(afterglow.camera_from_matrix(pose(), K, SIZE)), pixel_of(opencv))


@pytest.mark.parametrize("convention", ["opengl", "opencv"])
def test_matrices_of_a_camera_are_those_that_it_was_made_from(convention: str) -> None:
    camera = afterglow.camera_from_matrix(pose(), K, SIZE, convention=convention)
    assert np.allclose(afterglow.camera_matrix(camera, convention), pose())
    assert np.allclose(afterglow.intrinsic_matrix(camera, SIZE), K)


def test_intrinsics_of_a_field_of_view_have_their_centre_in_the_middle() -> None:
    k = afterglow.intrinsic_matrix(afterglow.camera_from_matrix(pose(), fov_y_deg=90.0), SIZE)
    assert np.allclose(k, [[24, 0, 31.5], [0, 24, 23.5], [0, 0, 1]])


@pytest.mark.parametrize(("options", "words"), [
    ({"pose": np.eye(3)}, "bad pose"),
    ({"pose": np.diag([2.0, 2, 2, 1])}, "rigid"),
    ({"pose": np.diag([1.0, 1, -1, 1])}, "rigid"),
    ({"pose": np.eye(4), "intrinsics": K}, "size"),
    ({"pose": np.eye(4), "intrinsics": np.array([[70, 5, 30], [0, 65, 25], [0, 0, 1.0]]), "size": SIZE}, "skew"),
    ({"pose": np.eye(4), "convention": "blender"}, "convention"),
])
def test_bad_matrices_are_refused_in_one_line(options: dict[str, object], words: str) -> None:
    with pytest.raises(SceneError, match=words) as caught:
        afterglow.camera_from_matrix(**options)
    assert "\n" not in str(caught.value)
