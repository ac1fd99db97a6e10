"""Key-framed motion of an object -> ``Motion``.

A ``Motion`` interpolates its matrices linearly, so rotations are split into small steps; otherwise an object would
shrink while it rotates.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from app.arrays import F64
from app.math3d import affine_matrix, axis_angle_matrix, euler_matrix
from app.scene import Motion

_MAX_STEP_DEG = 2.0
_MAX_STEPS = 10_000


@dataclass(frozen=True, eq=False)
class MotionKey:
    """One key: ``rotation`` is three angles in radians about x, y, z or, if ``about_axis``, a rotation vector."""

    time: float
    translate: F64
    rotation: F64
    about_axis: bool
    scale: F64


def motion_key(spec: Mapping[str, Any]) -> MotionKey:
    """A key from its scene JSON."""
    degrees = spec.get("rotate_deg", (0.0, 0.0, 0.0))
    about_axis = isinstance(degrees, Mapping)
    if about_axis:
        axis = np.asarray(degrees["axis"], np.float64)
        degrees = axis / max(float(np.linalg.norm(axis)), 1e-30) * degrees["angle_deg"]
    return MotionKey(
        time=float(spec["time"]),
        translate=np.asarray(spec.get("translate", (0.0, 0.0, 0.0)), np.float64),
        rotation=np.radians(np.asarray(degrees, np.float64)),
        about_axis=about_axis,
        scale=np.broadcast_to(np.asarray(spec.get("scale", 1.0), np.float64), 3).copy(),
    )


def build_motion(keys: Sequence[MotionKey], center: F64) -> Motion:
    """World-space matrices that move an object about ``center``, the centre of its box at rest, shape (3,)."""
    about_axis = any(k.about_axis for k in keys)
    steps = [keys[0]]
    for a, b in pairwise(keys):
        degrees = math.degrees(float(np.abs(b.rotation - a.rotation).sum()))
        count = min(max(1, math.ceil(degrees / _MAX_STEP_DEG)), _MAX_STEPS)
        steps += [_interpolate(a, b, i / count) for i in range(1, count + 1)]
    return Motion(np.array([s.time for s in steps]), np.array([_matrix(s, about_axis, center) for s in steps]))


def _interpolate(a: MotionKey, b: MotionKey, t: float) -> MotionKey:
    def lerp(x: Any, y: Any) -> Any:
        return (1 - t) * x + t * y

    return MotionKey(lerp(a.time, b.time), lerp(a.translate, b.translate), lerp(a.rotation, b.rotation), b.about_axis,
                     lerp(a.scale, b.scale))


def _matrix(key: MotionKey, about_axis: bool, center: F64) -> F64:
    rotation = axis_angle_matrix(key.rotation) if about_axis else euler_matrix(key.rotation)
    linear = rotation * key.scale
    return affine_matrix(linear, center + key.translate - linear @ center)
