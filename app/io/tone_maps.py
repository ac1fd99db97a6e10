"""Tone maps on the CPU, for pictures that the renderer has not drawn, such as references.

They are those of ``shaders/tonemap.frag``, whose files name the sources.
"""

from collections.abc import Callable

import numpy as np

from app.arrays import F32, F64, Bytes, Floats
from app.io.color_management import display_view, find_view
from app.io.image import srgb_encode, to_8bit
from app.math3d import LUMINANCE

MIDDLE_GREY = 0.18
AGX_INSET = np.array([[0.842479062253094, 0.0784335999999992, 0.0792237451477643],
                      [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
                      [0.0423756549057051, 0.0784336, 0.879142973793104]])
AGX_MIN_EV, AGX_MAX_EV = -12.47393, 4.026069
AGX_PIVOT = np.array([10 / 16.5, 0.5])
AGX_SLOPE, AGX_TOE, AGX_SHOULDER = 2.0, 3.0, 3.25
ACES_INPUT = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
ACES_OUTPUT = np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]])
NEUTRAL_F90, NEUTRAL_START, NEUTRAL_DESATURATION = 0.04, 0.76, 0.15


def tone_map(radiance: F32, exposure: float, name: str) -> Bytes:
    """``exposure`` times linear ``radiance``, shape (H, W, 3), by one of ``TONE_MAPS`` or a view of OpenColorIO."""
    if name not in _CURVES:
        return display_view(radiance, exposure, find_view(name))
    return to_8bit(_CURVES[name](radiance.astype(np.float64) * exposure))


def automatic_exposure(radiance: Floats) -> float:
    """The factor that brings the geometric mean luminance of what is not black to middle grey."""
    luminance = radiance @ LUMINANCE
    lit = luminance[luminance > 0]
    return MIDDLE_GREY / float(np.exp(np.log(lit).mean())) if len(lit) else 1.0


def _agx(x: F64) -> F64:
    stops = np.log2(np.maximum(x @ AGX_INSET.T, 1e-10))
    away = np.clip((stops - AGX_MIN_EV) / (AGX_MAX_EV - AGX_MIN_EV), 0.0, 1.0) - AGX_PIVOT[0]
    below = _agx_half(np.maximum(-away, 0.0), AGX_PIVOT, AGX_TOE)
    above = _agx_half(np.maximum(away, 0.0), 1 - AGX_PIVOT, AGX_SHOULDER)
    return np.asarray(np.clip((AGX_PIVOT[1] - below + above) @ np.linalg.inv(AGX_INSET).T, 0.0, 1.0))


def _agx_half(x: F64, limit: F64, exponent: float) -> F64:
    rise = AGX_SLOPE * limit[0] / limit[1]
    scale = AGX_SLOPE * limit[0] * (rise ** exponent - 1.0) ** (-1.0 / exponent)
    term = AGX_SLOPE * x / scale
    return np.asarray(scale * term / (1.0 + term ** exponent) ** (1.0 / exponent))


def _pbr_neutral(x: F64) -> F32:
    low = x.min(axis=-1, keepdims=True)
    x = x - np.where(low < 2 * NEUTRAL_F90, low - low * low / (4 * NEUTRAL_F90), NEUTRAL_F90)
    peak, room = x.max(axis=-1, keepdims=True), 1 - NEUTRAL_START
    high = np.maximum(peak, NEUTRAL_START)
    compressed = 1 - room * room / (high + room - NEUTRAL_START)
    grey = 1 - 1 / (NEUTRAL_DESATURATION * (high - compressed) + 1)
    return srgb_encode(np.where(peak < NEUTRAL_START, x, x * (compressed / high) * (1 - grey) + compressed * grey))


def _aces(x: F64) -> F32:
    v = x @ ACES_INPUT.T
    v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)
    return srgb_encode(v @ ACES_OUTPUT.T)


_CURVES: dict[str, Callable[[F64], Floats]] = {
    "srgb": srgb_encode, "agx": _agx, "pbr-neutral": _pbr_neutral, "aces": _aces}
