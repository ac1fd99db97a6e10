"""Matrices in plain numpy: float64, column vectors, right-handed.

Clip space has z in [0, 1] (``glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE)``).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from app.arrays import F64, Bools
from app.scene import Camera

MAX_PRODUCT = 2**18  # multiplications up to which OpenBLAS starts no threads

Real = TypeVar("Real", bound=np.floating[Any])


def row_blocks(rows: int, row_size: int) -> Iterator[slice]:
    """Slices of rows whose products with a matrix, ``row_size`` multiplications for a row, BLAS computes in one thread.

    Its other threads spin for a while after a product, and slow down what runs next.
    """
    step = max(1, MAX_PRODUCT // row_size)
    return (slice(start, min(start + step, rows)) for start in range(0, rows, step))


def normalize(v: F64) -> F64:
    """``v`` at unit length; a vector of length 0 stays 0."""
    length = float(np.linalg.norm(v))
    return v / length if length > 0 else v


def row_dots(a: NDArray[Real], b: NDArray[Real]) -> NDArray[Real]:
    """Dot products of the rows of two arrays of shape (N, D), in a third of the time of sums along the second axis."""
    return np.asarray(np.einsum("nd,nd->n", a, b))


def row_lengths(vectors: NDArray[Real]) -> NDArray[Real]:
    """Lengths of the rows of an array of shape (N, D)."""
    return np.asarray(np.sqrt(row_dots(vectors, vectors)))


def unit_rows(vectors: NDArray[Real]) -> NDArray[Real]:
    """Each row of an array of shape (N, D) at unit length; zero vectors stay zero."""
    return np.asarray(vectors / np.maximum(row_lengths(vectors)[:, None], 1e-30))


def fibonacci_sphere(count: int) -> F64:
    """Unit vectors on a Fibonacci lattice, shape (count, 3)."""
    k = np.arange(count) + 0.5
    y, angle = 1 - 2 * k / count, k * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - y * y)
    return np.stack([ring * np.cos(angle), y, ring * np.sin(angle)], axis=1)


def spread_points(corners: F64, area: F64, count: int, rng: np.random.Generator) -> tuple[F64, F64]:
    """Points spread evenly over triangles, and the unit normals there, both of shape (count, 3).

    Parameters
    ----------
    corners : ndarray, float64, shape (T, 3, 3)
    area : ndarray, float64, shape (T,)
        In any unit, not all zero.
    """
    a, b, c = np.moveaxis(corners[rng.choice(len(area), count, p=area / area.sum())], 1, 0)
    root, v = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    return (1 - root) * a + root * (1 - v) * b + root * v * c, unit_rows(np.cross(b - a, c - a))


def put_rows(target: NDArray[Any], rows: NDArray[np.integer[Any]], values: NDArray[Any]) -> None:
    """``target[rows] = values`` for a C-contiguous target of shape (N, D) and as many values as rows, in half the time.

    The reverse, ``target.take(rows, axis=0)``, is five times as fast as an index in brackets.
    """
    row = np.dtype((np.void, target.shape[1] * target.itemsize))
    target.view(row)[:, 0][rows] = np.ascontiguousarray(values, target.dtype).view(row)[:, 0]


def look_rotation(forward: F64, up: F64) -> F64:
    """World-to-camera rotation, shape (3, 3); rows are right, up and back."""
    back = -normalize(np.asarray(forward, np.float64))
    right = np.cross(np.asarray(up, np.float64), back)
    if np.linalg.norm(right) < 1e-9:  # looking along up, where any other axis will do
        right = np.cross(np.eye(3)[int(np.argmin(np.abs(back)))], back)
    right = normalize(right)
    return np.stack([right, np.cross(back, right), back])


def look_at(eye: F64, target: F64, up: F64) -> F64:
    """World-to-camera matrix, shape (4, 4); the camera looks down -z."""
    rotation = look_rotation(np.subtract(target, eye), up)
    return affine_matrix(rotation, -rotation @ np.asarray(eye, np.float64))


def perspective_reversed(tan_x: float, tan_y: float, near: float) -> F64:
    """Infinite reversed-Z projection, shape (4, 4): depth ``d`` lands on z = near / d."""
    return np.array([[1 / tan_x, 0, 0, 0], [0, 1 / tan_y, 0, 0], [0, 0, 0, near], [0, 0, -1.0, 0]])


def orthographic_reversed(half_width: float, half_height: float, far: float) -> F64:
    """Parallel projection with reversed Z, shape (4, 4): depth ``d`` lands on z = 1 - d / far."""
    return np.array([[1 / half_width, 0, 0, 0], [0, 1 / half_height, 0, 0], [0, 0, 1 / far, 1.0], [0, 0, 0, 1.0]])


def perspective(tan_half: float, near: float, far: float) -> F64:
    """Square projection with ordinary Z, shape (4, 4): near lands on 0, far on 1."""
    a = far / (near - far)
    return np.array([[1 / tan_half, 0, 0, 0], [0, 1 / tan_half, 0, 0], [0, 0, a, a * near], [0, 0, -1.0, 0]])


def orthographic(half: float, near: float, far: float) -> F64:
    """Square parallel projection with ordinary Z, shape (4, 4)."""
    return np.array([[1 / half, 0, 0, 0], [0, 1 / half, 0, 0],
                     [0, 0, 1 / (near - far), near / (near - far)], [0, 0, 0, 1.0]])


def translation(offset: F64) -> F64:
    """Matrix, shape (4, 4), that adds ``offset``."""
    return affine_matrix(np.eye(3), offset)


def affine_matrix(linear: F64, offset: Sequence[float] | F64 = (0.0, 0.0, 0.0)) -> F64:
    """Affine matrix, shape (4, 4), that applies ``linear``, shape (3, 3), and then adds ``offset``."""
    m = np.eye(4)
    m[:3, :3], m[:3, 3] = linear, offset
    return m


def quaternion_matrices(quaternions: F64) -> F64:
    """Rotation matrices, shape (N, 3, 3), of quaternions x, y, z, w, shape (N, 4); identity for zero quaternions."""
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    x, y, z, w = np.where(length > 0, quaternions / np.where(length > 0, length, 1.0), (0.0, 0.0, 0.0, 1.0)).T
    rows = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    return np.moveaxis(np.array(rows), 2, 0)


def axis_angle_matrix(rotation_vector: F64) -> F64:
    """Rotation, shape (3, 3), by the vector's length in radians about its direction."""
    angle = float(np.linalg.norm(rotation_vector))
    axis = rotation_vector / angle if angle > 0 else np.array([0.0, 1.0, 0.0])
    return quaternion_matrices(np.array([[*(axis * np.sin(angle / 2)), np.cos(angle / 2)]]))[0]


def euler_matrix(angles: F64) -> F64:
    """Rotation, shape (3, 3), by radians about x, then y, then z."""
    x, y, z = (axis_angle_matrix(a * e) for a, e in zip(angles, np.eye(3), strict=True))
    return np.asarray(z @ y @ x)


def normal_matrix(m: F64) -> F64:
    """Cofactor matrix of ``m``'s linear part, shape (3, 3): transforms normals, also where ``m`` is singular.

    Equal to det(m) · inverse transpose, so a mirrored ``m`` keeps the normal on its side of the surface
    up to a sign that the G-buffer resolves by the viewer.
    """
    columns = m[:3, :3].T
    return np.cross(columns[[1, 2, 0]], columns[[2, 0, 1]]).T


def affine_inverse(m: F64) -> F64 | None:
    """Inverse of the affine matrix ``m``, shape (4, 4); None where it flattens what it moves."""
    if np.linalg.matrix_rank(m[:3, :3]) < 3:
        return None
    return np.asarray(np.linalg.inv(m), np.float64)


def frustum_planes(clip: F64) -> F64:
    """The six planes, shape (6, 4), of clip matrix ``clip``; a point p is inside where plane · (p, 1) >= 0."""
    x, y, z, w = clip
    return np.stack([w + x, w - x, w + y, w - y, z, w - z])


def boxes_in_frustum(boxes: F64, planes: F64) -> Bools:
    """Which axis-aligned ``boxes``, shape (N, 2, 3), touch the frustum; conservative."""
    corner = np.where(planes[:, None, :3] >= 0, boxes[None, :, 1], boxes[None, :, 0])
    distance = np.einsum("pnk,pk->pn", corner, planes[:, :3]) + planes[:, None, 3]
    return np.asarray((distance >= 0).all(axis=0))


# Increments per axis of Roberts' R2 sequence ("The Unreasonable Effectiveness of Quasirandom Sequences").
R2 = (0.7548776662, 0.569840291)
GOLDEN_RATIO = (math.sqrt(5) - 1) / 2  # the same in one dimension
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of linear Rec. 709


def halton(index: int, base: int) -> float:
    """The ``index``-th number (from 1) of the radical-inverse sequence in ``base``, in (0, 1)."""
    result, fraction = 0.0, 1.0
    while index > 0:
        fraction /= base
        result += fraction * (index % base)
        index //= base
    return result


# Cube faces in contract order: front, back, left, right, up, down. Rows: forward, image up.
CUBE_FACES: F64 = np.array([
    [[0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 1, 0]], [[-1, 0, 0], [0, 1, 0]],
    [[1, 0, 0], [0, 1, 0]], [[0, 1, 0], [0, 0, 1]], [[0, -1, 0], [0, 0, -1]]], np.float64)


def cube_rotations() -> F64:
    """World-to-face rotations, shape (6, 3, 3), in contract order."""
    return np.stack([look_rotation(forward, up) for forward, up in CUBE_FACES])


@dataclass(frozen=True, eq=False)
class View:
    """A camera as matrices. Space "relative" is world axes with the eye as origin; clip units are from -1 to 1, y up.

    Attributes
    ----------
    eye : ndarray, float64, shape (3,)
        World space.
    rotation : ndarray, float64, shape (3, 3)
        Relative to camera space.
    half_size : tuple of float
        Half of the image's width and height: at distance 1, that is tangents of half the field of view; in scene units
        where ``is_orthographic``.
    near : float
        Distance of the near plane in scene units; of an orthographic view, the near plane is at the eye.
    center : tuple of float
        Where the view axis meets the image, in clip units.
    is_orthographic : bool
    far : float
        Distance in scene units beyond which nothing is; only an orthographic projection needs it.
    """

    eye: F64
    rotation: F64
    half_size: tuple[float, float]
    near: float
    center: tuple[float, float] = (0.0, 0.0)
    is_orthographic: bool = False
    far: float = float("inf")

    @staticmethod
    def of(camera: Camera, size: tuple[int, int], near: float, far: float = float("inf")) -> View:
        """The view of ``camera`` for an image ``size`` of width and height in pixels."""
        eye = np.asarray(camera.eye, np.float64)
        rotation = look_rotation(np.asarray(camera.target) - eye, np.asarray(camera.up))
        lens, aspect = camera.intrinsics, size[0] / size[1]
        if camera.orthographic_height is not None:
            half = camera.orthographic_height / 2
            return View(eye, rotation, (half * aspect, half), near, is_orthographic=True, far=far)
        if lens is not None:
            width = lens.height * aspect  # of the image in pixels of the intrinsics
            center = (2 * lens.cx - lens.width) / width, 1 - 2 * lens.cy / lens.height
            return View(eye, rotation, (width / (2 * lens.fx), lens.height / (2 * lens.fy)), near, center)
        tan_y = float(np.tan(np.radians(camera.fov_y_deg) / 2))
        return View(eye, rotation, (tan_y * size[0] / size[1], tan_y), near)

    @property
    def pose(self) -> F64:
        """Camera space to world space, shape (4, 4)."""
        return affine_matrix(self.rotation.T, self.eye)

    def intrinsics(self, size: tuple[int, int]) -> F64:
        """Intrinsics for an image ``size`` in pixels, shape (3, 3), with integers in the middle of pixels (OpenCV).

        x is right and y is down from the middle of the upper left pixel; only of a perspective view.
        """
        (width, height), (half_x, half_y), (x, y) = size, self.half_size, self.center
        return np.array([[width / (2 * half_x), 0.0, (1 + x) * width / 2 - 0.5],
                         [0.0, height / (2 * half_y), (1 - y) * height / 2 - 0.5],
                         [0.0, 0.0, 1.0]])

    def same_as(self, other: View) -> bool:
        """Whether the other view is from the same place, with the same projection."""
        return (np.array_equal(self.eye, other.eye) and np.array_equal(self.rotation, other.rotation)
                and (self.half_size, self.center, self.is_orthographic)
                == (other.half_size, other.center, other.is_orthographic))

    def clip_from_relative(self, jitter: tuple[float, float] = (0.0, 0.0)) -> F64:
        """Projection, shape (4, 4); ``jitter`` moves the image in clip units."""
        offset = self.center[0] + jitter[0], self.center[1] + jitter[1]
        if self.is_orthographic:
            projection = orthographic_reversed(*self.half_size, self.far)
            projection[:2, 3] = offset
        else:
            projection = perspective_reversed(*self.half_size, self.near)
            projection[0, 2], projection[1, 2] = -offset[0], -offset[1]
        return projection @ affine_matrix(self.rotation)

    def rays(self, image: F64) -> tuple[F64, F64]:
        """Origins and directions in relative space, shapes (N, 3), of rays through image points in clip units, (N, 2).

        Directions have length 1 along the view axis, so that the ray's parameter is the depth.
        """
        plane = (image - self.center) * self.half_size
        along = np.full((len(plane), 1), -1.0)
        if self.is_orthographic:
            return (np.concatenate([plane, np.zeros_like(along)], axis=1) @ self.rotation,
                    np.concatenate([np.zeros_like(plane), along], axis=1) @ self.rotation)
        return np.zeros((len(plane), 3)), np.concatenate([plane, along], axis=1) @ self.rotation
