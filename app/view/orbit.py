"""Where the eye may go when a drag turns the camera about a point: through no surface."""

from dataclasses import dataclass
from math import asin, radians

import numpy as np
from numpy.typing import NDArray

from app.arrays import F64, Bools
from app.math3d import View, axis_angle_matrix, normalize
from app.raycast.caster import Caster
from app.scene import Camera

COLUMNS = 72             # of the grid, in a full turn
STEP = radians(360 / COLUMNS)
MIN_FREE = COLUMNS // 2  # steps around the eye; before a flat wall they are always fewer
MAX_ELEVATION = radians(88.0)
OVERLAP = 0.01           # by which edges extend beyond their nodes, so that none slips by a surface through a node


@dataclass(frozen=True)
class Orbit:
    """Cells of a grid of turns by yaw about the camera's up vector, after a pitch about its right one.

    Attributes
    ----------
    first_row : int
        Pitch of the lower edge of the first row, in steps; the first column begins at a yaw of 0.
    free : list of str
        A row of ``COLUMNS`` cells for each step of pitch: ``1`` where the eye may be, because a way along the edges of
        cells leads there that no surface crosses.
    """

    first_row: int
    free: list[str]
    step: float = STEP


def plan_orbit(caster: Caster, camera: Camera, pivot: F64) -> Orbit | None:
    """The grid about ``pivot``, shape (3,), in world space; None where walls leave less than half a turn.

    Pitch ends where the view direction would pass the up vector.
    """
    up, right = normalize(np.asarray(camera.up, np.float64)), View.of(camera, (1, 1), 1.0).rotation[0]
    elevation = asin(np.clip(normalize(np.subtract(camera.target, camera.eye)) @ up, -1.0, 1.0))
    first = min(-int((MAX_ELEVATION + elevation) / STEP), 0)
    last = max(int((MAX_ELEVATION - elevation) / STEP), 0)
    arms = np.stack([axis_angle_matrix(row * STEP * right) @ np.subtract(camera.eye, pivot)
                     for row in range(first, last + 1)])
    turns = np.stack([axis_angle_matrix(column * STEP * up) for column in range(COLUMNS)])
    nodes = pivot - caster.origin + np.einsum("cij,rj->rci", turns, arms)
    right_free = _is_free(caster, nodes, np.roll(nodes, -1, axis=1))  # from each node to its neighbour
    up_free = _is_free(caster, nodes[:-1], nodes[1:])
    if _free_steps(right_free[-first]) < MIN_FREE:
        return None
    reached = _reach(right_free, up_free, -first)
    edges = up_free & np.roll(up_free, -1, axis=1) & right_free[:-1] & right_free[1:]
    return Orbit(first, ["".join("1" if cell else "0" for cell in row) for row in edges & reached[:-1]])


def _is_free(caster: Caster, start: F64, end: F64) -> Bools:
    """Whether no surface is between points in local space, shapes (R, C, 3)."""
    along = end - start
    origins, vectors = (v.reshape(-1, 3).astype(np.float32) for v in (start - OVERLAP * along, along))
    hits = caster.cast(origins, vectors, t_max=np.full(len(origins), 1 + 2 * OVERLAP, np.float32))
    return np.asarray(hits.body < 0).reshape(start.shape[:2])


def _free_steps(row: Bools) -> int:
    """How many steps around the first node are free, to both sides together."""
    blocked = np.flatnonzero(~row)
    return int(blocked[0] + COLUMNS - 1 - blocked[-1]) if len(blocked) else COLUMNS


def _reach(right_free: Bools, up_free: Bools, row: int) -> Bools:
    """Nodes to which free edges lead from the first one of a row."""
    reached: NDArray[np.bool_] = np.zeros(right_free.shape, np.bool_)
    reached[row, 0] = True
    while True:
        before = reached.copy()
        reached |= np.roll(reached & right_free, 1, axis=1)
        reached |= np.roll(reached, -1, axis=1) & right_free
        reached[1:] |= reached[:-1] & up_free
        reached[:-1] |= reached[1:] & up_free
        if np.array_equal(reached, before):
            return reached
