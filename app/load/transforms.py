"""Small matrices, in float64, column vectors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.scene import F64


def compose(translation: Sequence[float], rotation: F64, scale: Sequence[float]) -> F64:
    """Translation × rotation (3, 3) × scale as one matrix, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.asarray(scale, np.float64)
    matrix[:3, 3] = translation
    return matrix


def quaternion_matrices(quaternions: F64) -> F64:
    """Rotation matrices, shape (N, 3, 3), of quaternions x, y, z, w, shape (N, 4); zero ones turn nothing."""
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
