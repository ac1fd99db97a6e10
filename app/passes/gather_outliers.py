"""Spreads the light of rays that are far brighter than is expected over the surface around.

While something moves, history is a mean of the four texels around a texel's former place. That spreads a single bright
ray over texels that agree, so that no cleaning can tell it from light. In a first frame it is one of few rays.
"""

import numpy as np

from app.arrays import F32, Ints
from app.math3d import LUMINANCE, row_dots

MAX_RATIO = 16.0      # of the light of a texel's rays, in all, to the light that is expected,
MAX_MEAN_RATIO = 4.0  # where their mean is at least so many times as bright
MAX_ADDED = 1.0       # light that the spread one may add to a texel, to that which is expected; the rest is lost
MIN_EXPECTED = 0.1    # of the light of the frame
MAX_OUTLIERS = 128    # texels whose light is spread in a frame, the brightest ones
REACH = 32            # texels to each side that it is spread over,
MIN_COSINE = 0.9      # if the normals there differ by no more
MAX_OFF_PLANE = 0.02  # and the places lie no farther off the plane, in units of the distance from the eye


def spread_outliers(light: F32, expected: F32, rays: int, texel: Ints, position: F32, normal: F32,
                    grid: tuple[int, int]) -> F32:
    """Light of N texels without outliers, with the same sum where the surface is large enough.

    Parameters
    ----------
    light, expected : ndarray, float32, shape (N, 3)
        Mean of a texel's ``rays`` in this frame, and light that is interpolated there.
    texel : ndarray of int, shape (N,)
        Of the ``grid`` of width and height, row by row.
    position, normal : ndarray, float32, shape (N, 3)
        Relative to the eye, in world axes; unit normals.
    """
    weights = LUMINANCE.astype(np.float32)
    brightness, usual = light @ weights, expected @ weights
    if len(usual):
        usual = np.maximum(usual, MIN_EXPECTED * max(float(usual.mean()), float(np.median(brightness))))
    limit = max(MAX_RATIO / rays, MAX_MEAN_RATIO) * usual
    outliers = np.flatnonzero((brightness > limit) & (usual > 0))
    outliers = outliers[np.argsort(-brightness[outliers], kind="stable")[:MAX_OUTLIERS]]
    if len(outliers) == 0:
        return light
    excess = light[outliers] * (1 - limit[outliers] / brightness[outliers])[:, None]
    outlier, row = _around(outliers, texel, grid)
    own = outliers[outlier]
    off = np.abs(row_dots(position[row] - position[own], normal[own]))
    alike = (row_dots(normal[own], normal[row]) >= MIN_COSINE) & (
        off <= MAX_OFF_PLANE * np.sqrt(row_dots(position[own], position[own])))
    weight = usual[row] * (alike | (row == own))
    weight /= np.bincount(outlier, weight, len(outliers))[outlier]
    added = np.stack([np.bincount(row, weight * of_channel[outlier], len(light)) for of_channel in excess.T], axis=1)
    share = np.minimum(MAX_ADDED * usual / np.maximum(added @ weights, 1e-30), 1)
    spread = light + (added * share[:, None]).astype(np.float32)
    spread[outliers] -= excess
    return spread


def _around(chosen: Ints, texel: Ints, grid: tuple[int, int]) -> tuple[Ints, Ints]:
    """Pairs of an index into ``chosen`` and the row of a texel within ``REACH`` of it."""
    row_of = np.full((grid[1] + 2 * REACH, grid[0] + 2 * REACH), -1)
    y, x = np.divmod(texel, grid[0])
    row_of[y + REACH, x + REACH] = np.arange(len(texel))
    windows = np.lib.stride_tricks.sliding_window_view(row_of, (2 * REACH + 1, 2 * REACH + 1))
    around = windows[y[chosen], x[chosen]].reshape(len(chosen), -1)
    outlier, column = np.nonzero(around >= 0)
    return outlier, around[outlier, column]
