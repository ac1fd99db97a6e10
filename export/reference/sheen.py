"""Light that fibres scatter back (KHR_materials_sheen), with the interface of ``GgxLobe``."""

import math
from functools import cache
from typing import Any

import drjit as dr
import numpy as np

from app.arrays import F64

MIN_ALPHA = 1e-2  # as in shaders/include/sheen.glsl; narrower lobes are nothing but a rim
# Numbers of the fit of the shadowing term: for alpha 0, and for alpha 1 (Estevez and Kulla 2017, table 1).
SHADOWING = ((25.3245, 3.32435, 0.16801, -1.27393, -4.85967), (21.5473, 3.82987, 0.19823, -1.97760, -4.32054))
TABLE_SIZE = 32
STEPS = 128       # of quadrature, along each axis


class SheenLobe:
    """Estevez and Kulla 2017, "Production Friendly Microfacet Sheen BRDF", without its softened terminator.

    All directions are unit vectors in world space that point away from the surface.

    Parameters
    ----------
    mi : module
        Mitsuba.
    normal, v : mitsuba.Vector3f
        Shading normal, and the direction towards the viewer.
    color : mitsuba.Color3f
    roughness : mitsuba.Float
        Perceptual; alpha is its square.
    """

    def __init__(self, mi: Any, normal: Any, v: Any, color: Any, roughness: Any) -> None:
        self._mi, self._frame, self._color, self._roughness = mi, mi.Frame3f(normal), color, roughness
        self._v = self._frame.to_local(v)
        self.roughness = 1.0  # sampled as widely as diffuse light

    def sample(self, u: Any) -> Any:
        return self._frame.to_world(self._mi.warp.square_to_cosine_hemisphere(u))

    def pdf(self, l: Any) -> Any:  # noqa: E741
        return dr.maximum(self._frame.to_local(l).z, 0) / dr.pi

    def eval(self, l: Any) -> Any:  # noqa: E741
        """The lobe without its colour, times the cosine of ``l``; 0 below the horizon."""
        l = self._frame.to_local(l)  # noqa: E741
        n_l, n_v = dr.maximum(l.z, 1e-3), dr.maximum(self._v.z, 1e-3)
        h = dr.normalize(l + self._v)
        alpha = dr.maximum(self._roughness * self._roughness, MIN_ALPHA)
        distribution = (2 + 1 / alpha) * dr.power(dr.safe_sqrt(1 - h.z * h.z), 1 / alpha) / (2 * dr.pi)
        shadowing = 1 + _shadowing(n_l, alpha, dr) + _shadowing(n_v, alpha, dr)
        return dr.select(l.z > 0, distribution / (4 * n_v * shadowing), 0)

    def tint(self, l: Any) -> Any:  # noqa: E741
        return self._color

    def albedo(self) -> Any:
        """Share of light from everywhere that is reflected."""
        mi = self._mi
        table = mi.Texture2f(mi.TensorXf(sheen_albedo()[..., None].astype(np.float32)),
                             wrap_mode=dr.WrapMode.Clamp)
        return self._color * table.eval(mi.Point2f(dr.maximum(self._v.z, 0), self._roughness))[0]

    def base_share(self) -> Any:
        """What the sheen leaves of the light that the layers below reflect."""
        return 1 - dr.max(self.albedo())


@cache
def sheen_albedo() -> F64:
    """Share of light from everywhere that a white sheen reflects; rows of roughness, columns of the view's cosine.

    Sampled in the middles of ``TABLE_SIZE`` parts of [0, 1] along each axis.
    """
    middles = (np.arange(TABLE_SIZE) + 0.5) / TABLE_SIZE
    steps = (np.arange(STEPS) + 0.5) / STEPS
    alphas = np.maximum(middles**2, MIN_ALPHA)
    n_v = middles[:, None, None]
    n_l, phi = steps[:, None], 2 * math.pi * steps
    cosine = n_l * n_v + np.sqrt((1 - n_l**2) * (1 - n_v**2)) * np.cos(phi)
    n_h2 = (n_l + n_v) ** 2 / np.maximum(2 + 2 * cosine, 1e-12)
    log_sine = 0.5 * np.log(np.clip(1 - n_h2, 1e-30, 1))
    shares = [((2 + 1 / alpha) * np.exp(log_sine / alpha)
               / (4 * n_v * (1 + _shadowing(n_l, alpha, np) + _shadowing(n_v, alpha, np)))).mean(axis=(-2, -1))
              for alpha in alphas]
    return np.clip(np.stack(shares), 0, 1)


def _shadowing(cosine: Any, alpha: Any, xp: Any) -> Any:
    """Smith's Λ of the distribution, by a fit; ``xp`` is the module of the arrays."""
    share = (1 - alpha) * (1 - alpha)
    a, b, c, d, e = (rough + share * (smooth - rough) for smooth, rough in zip(*SHADOWING, strict=True))

    def exponent(x: Any) -> Any:
        return a / (1 + b * x**c) + d * x + e

    folded = exponent(xp.minimum(cosine, 1 - cosine))
    is_steep = cosine < 0.5
    return xp.exp(xp.where(is_steep, folded, 2 * exponent(0.5) - folded) if xp is np
                  else xp.select(is_steep, folded, 2 * exponent(0.5) - folded))
