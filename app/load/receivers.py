"""Points on the surfaces that emitters light."""

import numpy as np

from app.arrays import F64
from app.load.geometry import face_vectors, place
from app.load.light_fit import Receivers
from app.load.scene_builder import SceneBuilder
from app.math3d import spread_points

POINTS = 128
MAX_TRIANGLES = 2**16  # of a mesh, among which points are chosen


def sample_receivers(builder: SceneBuilder, skipped: set[int]) -> Receivers:
    """``POINTS`` points spread evenly over all instances but ``skipped``, each with both normals; none without area."""
    rng = np.random.default_rng(0)
    corners, areas = [], []
    for index, instance in enumerate(builder.instances):
        if index in skipped:
            continue
        mesh = builder.meshes[instance.mesh]
        step = max(1, -(-len(mesh.triangles) // MAX_TRIANGLES))
        positions = place(mesh, instance)
        corners.append(positions[mesh.triangles[::step]])
        areas.append(step * np.linalg.norm(face_vectors(positions, mesh.triangles[::step]), axis=1))
    area = np.concatenate([np.zeros(0), *areas])
    if not area.sum() > 0:
        return Receivers(np.zeros((0, 3)), np.zeros((0, 3)))
    return _with_both_sides(*spread_points(np.concatenate(corners), area, POINTS, rng))


def surround(low: F64, high: F64) -> Receivers:
    """``POINTS`` points on a sphere around a box, as receivers where there are no surfaces."""
    z = 1 - (2 * np.arange(POINTS) + 1) / POINTS
    angle = np.arange(POINTS) * np.pi * (3 - np.sqrt(5))  # a Fibonacci lattice
    sine = np.sqrt(1 - z * z)
    directions = np.stack([sine * np.cos(angle), sine * np.sin(angle), z], axis=1)
    return Receivers((low + high) / 2 + np.linalg.norm(high - low) * directions, -directions)


def _with_both_sides(position: F64, normal: F64) -> Receivers:
    return Receivers(np.concatenate([position, position]), np.concatenate([normal, -normal]))
