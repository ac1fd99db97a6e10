"""Planes of walls that surfels must not light through.

The kernel that interpolates light between surfels knows positions and normals only. Two pieces of floor on both sides
of a wall, one dark and one thousands of times as bright, are neighbours to it. So each surfel whose neighbours stand
behind a wall gets the plane of that wall, and has no weight beyond it.
"""

import numpy as np

from app.arrays import F32, Bools, Ints
from app.math3d import row_blocks
from app.raycast.caster import STATIC, Caster
from app.surfels import kernel

NEIGHBOURS = 16            # of a surfel, by the weight that it has there
LIFTS = (1.0, 0.5, 0.1)    # radii above the surfaces at which the neighbour must be hidden: low things are no walls
MIN_COSINE = 0.2           # between a ray and the wall that it meets


def find_clip_planes(caster: Caster, position: F32, normal: F32, radius: F32, height: F32) -> F32:
    """The plane beyond which each surfel has no weight.

    Of the walls between a surfel and its neighbours, the one is taken that hides the most weight of hidden neighbours
    and the least of visible ones.

    Parameters
    ----------
    caster : Caster
        Only its static body counts.
    position, normal : ndarray, float32, shape (S, 3)
        Local space.
    radius, height : ndarray, float32, shape (S,)
        The kernel's radius, and how far the surfel sees along its normal; neighbours are looked for at no more height.

    Returns
    -------
    ndarray, float32, shape (S, 4)
        Unit normal, pointing away from the surfel, and minus the distance along it, in local space; zeros for none.
    """
    if len(position) < 2:
        return np.zeros((len(position), 4), np.float32)
    near, weight = _neighbours(position - position.mean(axis=0), normal, radius)
    surfel = np.repeat(np.arange(len(position)), near.shape[1])
    hidden = weight.ravel() > 0
    wall = np.zeros((len(surfel), 4), np.float32)
    for lift in LIFTS:
        rows = np.flatnonzero(hidden)
        start, end = (position[k] + normal[k] * np.minimum(lift * radius[k], height[k])[:, None]
                      for k in (surfel[rows], near.ravel()[rows]))
        blocked, wall[rows] = _walls_between(caster, start, end)
        hidden[rows[~blocked]] = False
    hidden, wall = hidden.reshape(near.shape), wall.reshape(*near.shape, 4)
    depth = np.einsum("skc,snc->skn", wall[..., :3], position[near]) + wall[..., 3:]  # [S, plane, neighbour]
    beyond = depth > kernel.CLIP_MARGIN * radius[:, None, None]
    gain = (beyond * np.where(hidden, weight, -weight)[:, None]).sum(axis=2)
    in_front = (wall[..., :3] * position[:, None]).sum(axis=2) + wall[..., 3] < 0
    gain[~(hidden & in_front)] = 0.0
    best = gain.argmax(axis=1)
    rows = np.arange(len(position))
    return np.asarray(np.where(gain[rows, best, None] > 0, wall[rows, best], 0.0), np.float32)


def _neighbours(position: F32, normal: F32, radius: F32) -> tuple[Ints, F32]:
    """Indices and weights of the surfels where each one's kernel is largest, shape (S, ``NEIGHBOURS``)."""
    count = min(NEIGHBOURS, len(position) - 1)
    near, weight = np.zeros((len(position), count), np.int64), np.zeros((len(position), count), np.float32)
    key, query = kernel.keys(position, normal, radius), kernel.queries(position, normal)
    for block in row_blocks(len(position), query.size):
        exponent = key[block] @ query.T
        rows = np.arange(len(exponent))
        exponent[rows, block.start + rows] = -np.inf
        near[block] = np.argpartition(-exponent, count - 1, axis=1)[:, :count]
        weight[block] = np.exp(exponent[rows[:, None], near[block]])
    return near, weight


def _walls_between(caster: Caster, start: F32, end: F32) -> tuple[Bools, F32]:
    """Whether a static surface lies between points, shape (N,), and its plane, shape (N, 4)."""
    along = end - start
    length = np.linalg.norm(along, axis=1)
    direction = along / np.maximum(length, 1e-30)[:, None]
    hits = caster.cast(start, direction, (STATIC,), length)
    outwards = -hits.normal
    plane = np.concatenate([outwards, -(outwards * hits.position).sum(axis=1, keepdims=True)], axis=1)
    blocked = (hits.body >= 0) & ((outwards * direction).sum(axis=1) > MIN_COSINE)
    return np.asarray(blocked), plane
