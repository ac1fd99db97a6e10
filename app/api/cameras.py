"""Cameras as matrices: a pose, shape (4, 4), and intrinsics, shape (3, 3), in the convention of OpenGL or OpenCV.

A pose maps camera space to world space. In OpenGL's camera space x points right, y up, and the camera looks along -z;
in OpenCV's x points right, y down, and the camera looks along +z. Intrinsics are those of OpenCV in both: pixels, the
origin in the middle of the upper left pixel. ``Intrinsics`` counts from that pixel's upper left corner instead.
"""

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from app.api.checked import check_camera, check_size, read_array
from app.arrays import F64
from app.errors import SceneError
from app.load.scene_builder import vector
from app.math3d import View
from app.scene import Camera, Intrinsics

Convention = Literal["opengl", "opencv"]

_FLIPS = {"opengl": np.eye(4), "opencv": np.diag([1.0, -1.0, -1.0, 1.0])}
_CENTER = 0.5      # of the upper left pixel, from its corner
_TOLERANCE = 1e-3  # of a rotation's axes, and of skew relative to the focal length
_WHERE = "camera"


def camera_from_matrix(pose: ArrayLike, intrinsics: ArrayLike | None = None, size: tuple[int, int] | None = None, *,
                       convention: Convention = "opengl", fov_y_deg: float = 45.0) -> Camera:
    """A camera from its pose.

    Parameters
    ----------
    pose : array_like, shape (4, 4)
        Camera space to world space: a rotation and a translation.
    intrinsics : array_like, shape (3, 3), optional
        ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]`` in pixels, with integers in the middle of pixels; needs ``size``.
    size : tuple of int, optional
        Width and height in pixels of the image that the intrinsics belong to.
    convention : {"opengl", "opencv"}
        Of the pose.
    fov_y_deg : float
        Vertical field of view in degrees, without ``intrinsics``.

    Raises
    ------
    SceneError
        When a matrix has another shape or form.
    """
    matrix = _matrix(pose, (4, 4), "pose") @ _flip(convention)
    rotation = matrix[:3, :3]
    if (np.abs(rotation.T @ rotation - np.eye(3)).max() > _TOLERANCE or np.linalg.det(rotation) < 0
            or np.abs(matrix[3] - (0, 0, 0, 1)).max() > _TOLERANCE):
        raise SceneError("the pose is no rigid transform", _WHERE, "expected a rotation and a translation")
    eye = matrix[:3, 3]
    return check_camera(Camera(vector(eye), vector(eye - rotation[:, 2]), vector(rotation[:, 1]), fov_y_deg,
                               intrinsics=None if intrinsics is None else _intrinsics(intrinsics, size)))


def camera_matrix(camera: Camera, convention: Convention = "opengl") -> F64:
    """The pose of ``camera``, float64, shape (4, 4): camera space to world space."""
    return np.asarray(View.of(check_camera(camera), (1, 1), 1.0).pose @ _flip(convention))


def intrinsic_matrix(camera: Camera, size: tuple[int, int]) -> F64:
    """Intrinsics of ``camera`` for an image ``size`` of width and height in pixels, float64, shape (3, 3).

    Raises
    ------
    SceneError
        When it projects in parallel.
    """
    camera, size = check_camera(camera), check_size(size)
    if camera.orthographic_height is not None:
        raise SceneError("an orthographic camera has no intrinsics", _WHERE, "expected a perspective camera")
    return View.of(camera, size, 1.0).intrinsics(size)


def _flip(convention: str) -> F64:
    if convention not in tuple(_FLIPS):
        raise SceneError(f"unknown convention {convention!r}", _WHERE, f"expected one of: {', '.join(_FLIPS)}")
    return _FLIPS[convention]


def _intrinsics(values: ArrayLike, size: tuple[int, int] | None) -> Intrinsics:
    if size is None:
        raise SceneError("intrinsics need the size of their image", _WHERE, "expected size=(width, height)")
    k = _matrix(values, (3, 3), "intrinsics")
    fx, fy = float(k[0, 0]), float(k[1, 1])
    if not (fx > 0 and fy > 0 and math.hypot(k[0, 1], k[1, 0]) <= _TOLERANCE * fx and np.array_equal(k[2], (0, 0, 1))):
        raise SceneError("the intrinsics have skew or no focal length", _WHERE,
                         "expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    return Intrinsics(fx, fy, float(k[0, 2]) + _CENTER, float(k[1, 2]) + _CENTER, *map(float, check_size(size)))


def _matrix(values: ArrayLike, shape: tuple[int, int], name: str) -> F64:
    expected = f"expected finite numbers of the shape {shape}"
    matrix = read_array(values, f"{_WHERE}: {name}", expected)
    if matrix.shape != shape or not np.isfinite(matrix).all():
        raise SceneError(f"bad {name} of the shape {matrix.shape}", _WHERE, expected)
    return matrix
