"""Which texels of the grid of gathered light trace rays in a frame, and how many."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from app.arrays import Bools
from app.gl.frame_state import FrameState, MotionKind
from app.gl.ray_budget import RayBudget

RAYS = RayBudget(first_rays=2**17, max_first_samples=16, changed_rays=2**15, rays=2**14, max_samples=4)
AT_REST = replace(RAYS, rays=2**16)  # where nothing moves
HISTORY_FRAMES = {MotionKind.NONE: 4096, MotionKind.CAMERA: 96, MotionKind.OBJECTS: 8}  # whose rays count at most
TURN = np.array([[0, 1], [3, 2]])  # of the texels of 2×2, where not all of them can trace rays in each frame


def turns_of(frame: FrameState, texels: int, has_history: bool) -> tuple[int, range]:
    """Of how many frames a texel traces rays in one, and the numbers of these rays."""
    budget = AT_REST if frame.motion is MotionKind.NONE else RAYS
    return budget.turns(frame, texels, has_history, 1 if frame.relit else TURN.size)  # no history knows the new light


def max_rays(frame: FrameState, texels: int) -> float:
    """How many rays of its history count for a texel."""
    turns, chosen = turns_of(frame, texels, has_history=True)
    return max(1.0, HISTORY_FRAMES[frame.motion] * len(chosen) / turns)


@lru_cache(maxsize=2 * TURN.size)
def is_turn(grid: tuple[int, int], turns: int, turn: int) -> Bools:
    """Whether it is the turn of each texel of a ``grid``."""
    y, x = np.divmod(np.arange(math.prod(grid)), grid[0])
    chosen = np.asarray(TURN[y % 2, x % 2] % turns == turn)
    chosen.flags.writeable = False  # it is cached
    return chosen
