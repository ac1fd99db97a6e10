"""Key-framed motion of an object -> Motion.

A ``Motion`` is linear between its matrices, so turns are cut into small steps: an object keeps its size while it turns.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from app.load.transforms import axis_angle_matrix, compose, euler_matrix
from app.scene import F64, Motion

_STEP_DEG = 2.0
_MAX_STEPS = 10_000


@dataclass(frozen=True, eq=False)
class MotionKey:
    """One key: ``turn`` is three angles in radians about x, y, z or, when ``about_axis``, a rotation vector."""

    time: float
    translate: F64
    turn: F64
    about_axis: bool
    scale: F64


def motion_key(spec: Mapping[str, Any]) -> MotionKey:
    """A key as the scene JSON writes it."""
    turn = spec.get("rotate_deg", (0.0, 0.0, 0.0))
    about_axis = isinstance(turn, Mapping)
    if about_axis:
        axis = np.asarray(turn["axis"], np.float64)
        turn = axis / max(float(np.linalg.norm(axis)), 1e-30) * turn["angle_deg"]
    return MotionKey(
        time=float(spec["time"]),
        translate=np.asarray(spec.get("translate", (0.0, 0.0, 0.0)), np.float64),
        turn=np.radians(np.asarray(turn, np.float64)),
        about_axis=about_axis,
        scale=np.broadcast_to(np.asarray(spec.get("scale", 1.0), np.float64), 3).copy(),
    )


def build_motion(keys: Sequence[MotionKey], center: F64) -> Motion:
    """World-space matrices that move an object about ``center``, the middle of its box at rest, shape (3,)."""
    about_axis = any(k.about_axis for k in keys)
    steps = [keys[0]]
    for a, b in pairwise(keys):
        degrees = math.degrees(float(np.abs(b.turn - a.turn).sum()))
        count = min(max(1, math.ceil(degrees / _STEP_DEG)), _MAX_STEPS)
        steps += [_between(a, b, i / count) for i in range(1, count + 1)]
    return Motion(np.array([s.time for s in steps]), np.array([_matrix(s, about_axis, center) for s in steps]))


def _between(a: MotionKey, b: MotionKey, t: float) -> MotionKey:
    def mix(x: Any, y: Any) -> Any:
        return (1 - t) * x + t * y

    return MotionKey(mix(a.time, b.time), mix(a.translate, b.translate), mix(a.turn, b.turn), b.about_axis,
                     mix(a.scale, b.scale))


def _matrix(key: MotionKey, about_axis: bool, center: F64) -> F64:
    rotation = axis_angle_matrix(key.turn) if about_axis else euler_matrix(key.turn)
    matrix = compose((0.0, 0.0, 0.0), rotation, key.scale.tolist())
    matrix[:3, 3] = center + key.translate - matrix[:3, :3] @ center
    return matrix
