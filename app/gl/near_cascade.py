"""Near cascades: second shadow maps of parallel light, for what is around the eye.

The map of a whole scene shows a room amid a large garden by texels that are much larger than pixels. A cascade has
smaller ones and covers what is near (Dimitrov 2007, "Cascaded Shadow Maps"). It follows the eye in steps, so it is
seldom drawn again.
"""

import math
from dataclasses import dataclass

import numpy as np

from app.arrays import F64
from app.gl.shadow_atlas import CASCADE_TEXELS, FACE_TEXELS, PARALLEL_MAP

MIN_RELATIVE_HALF = 8.0  # least half width of a map that has a cascade, in distances of what is near
STEPS = 4                # along a cascade's half width, in which it follows the eye


@dataclass(frozen=True)
class Cascade:
    """A square of the plane of a directional light's map.

    Attributes
    ----------
    center : tuple of float
        Relative to that of the whole map, in scene units along its axes.
    half : float
        Half width, in scene units.
    """

    center: tuple[float, float]
    half: float


def cascade_around(eye: F64, half: float, near: float) -> Cascade | None:
    """The near cascade for an eye, or None where the whole map shows as much.

    Parameters
    ----------
    eye : ndarray, float64, shape (2,)
        Relative to the centre of the whole map, along its axes.
    half : float
        Half width of the whole map.
    near : float
        Distance of what is near the eye.

    Notes
    -----
    Texels of the whole map are w = 2 half / (N a near) pixels wide at what is near, with N of them along the map and
    pixels of angle a; those of a cascade of half width c and N / m texels are w m c / half wide there. At the cascade's
    edge those of the whole map are w near / c wide. Both are small together where c² = half near / m.
    """
    if not (np.isfinite(eye).all() and half >= MIN_RELATIVE_HALF * near):
        return None
    relative_texels = FACE_TEXELS[PARALLEL_MAP] / CASCADE_TEXELS
    ratio = relative_texels * half / max(near, 1e-6 * half)
    own = half / 2.0 ** round(math.log2(ratio) / 2)
    step = own / STEPS
    x, y = np.round(eye / step) * step
    return Cascade((float(x), float(y)), own)
