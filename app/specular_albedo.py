"""Directional albedo of the GGX lobe, with light that it scatters more than once: shaders/include/specular_albedo.glsl.

Everything but ``specular_albedo`` takes and gives numbers or arrays of any library, such as Dr.Jit's.
"""

from typing import Any

import numpy as np

from app.arrays import F32

MIN_ALPHA = 2e-3   # as in shaders/include/ggx_lobe.glsl
MIN_COSINE = 1e-3  # of the viewing angle, as in the fit
MEAN_COSINE = 2 / 3  # between a normal and the light that arrives from everywhere
# Fitted by scripts/fit_specular_albedo.py. Columns are powers of alpha and of the roughness, rows those of t.
ALBEDO = ((0.0714, 0.8686, 3.8181, -0.6607), (1.0981, -5.9803, -13.6567, -2.9335), (-1.4322, 10.3178, 51.7082, 19.1513),
          (-0.9956, -4.1705, -73.4694, -66.5392), (1.2612, -0.5732, 24.0084, 75.1198))
FRESNEL = ((0.9994, -1.2398, 2.1184, -0.8626), (-0.0619, 3.5864, -14.6455, 14.5119),
           (0.0791, -2.9028, 22.8373, -4.2034))


def lobe_albedo(alpha: Any, n_v: Any) -> Any:
    """Share of light from everywhere that the lobe reflects once towards ``n_v``, without a Fresnel term.

    ``alpha`` is at least ``MIN_ALPHA``, the cosine ``n_v`` in [``MIN_COSINE``, 1].
    """
    t = n_v / (n_v + alpha)
    return 1 - t * _polynomial(ALBEDO, t, alpha)


def lobe_fresnel(roughness: Any, alpha: Any, n_v: Any) -> Any:
    """Mean of Schlick's (1 - v·h)⁵ over what the lobe reflects; may leave [0, 1] by rounding."""
    t, spread = n_v / (n_v + alpha), (1 - n_v) * (1 - n_v) / (1 + 4 * alpha)
    return spread * spread * (1 - n_v) * _polynomial(FRESNEL, t, roughness)


def multiple_scattering(f0: Any, albedo: Any) -> Any:
    """What the lobe reflects once, times this, is all that it reflects (Turquin 2019); ``albedo``: ``lobe_albedo``."""
    return 1 + f0 * (1 / albedo - 1)


def specular_albedo(f0: F32, roughness: F32, n_v: F32) -> F32:
    """Share of light from everywhere that the lobe reflects, shape (N, 3); nothing where F0 is 0.

    Parameters
    ----------
    f0 : ndarray, float32, shape (N, 3)
        Reflectance at normal incidence.
    roughness, n_v : ndarray, float32, shape (N, 1)
        Perceptual roughness; cosine between the normal and the view.
    """
    roughness, n_v = np.clip(roughness, 0, 1), np.clip(n_v, MIN_COSINE, 1)
    alpha = np.maximum(roughness * roughness, MIN_ALPHA)
    albedo, fresnel = lobe_albedo(alpha, n_v), np.clip(lobe_fresnel(roughness, alpha, n_v), 0, 1)
    reflected = albedo * (f0 + (1 - f0) * fresnel) * multiple_scattering(f0, albedo)
    return np.where(f0.max(axis=1, keepdims=True) > 0, reflected, 0).astype(np.float32)


def _polynomial(rows: tuple[tuple[float, ...], ...], t: Any, y: Any) -> Any:
    """Σ rows[i][j] tⁱ yʲ."""
    total = 0 * t
    for row in reversed(rows):
        inner = row[-1] + 0 * y
        for c in reversed(row[:-1]):
            inner = inner * y + c
        total = total * t + inner
    return total
