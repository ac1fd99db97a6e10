"""The renderer's reflections on a rough surface, for the path tracer: shaders/include/ggx.glsl and what it includes."""

from typing import Any

import drjit as dr

from app.specular_albedo import MIN_ALPHA, MIN_COSINE, lobe_albedo, lobe_fresnel, multiple_scattering


class GgxLobe:
    """Trowbridge-Reitz microfacets with height-correlated Smith shadowing (Heitz 2014) and Schlick's Fresnel factor.

    Light that microfacets scatter more than once is added in proportion to what they scatter once (Turquin 2019).

    All directions are unit vectors in world space that point away from the surface.

    Parameters
    ----------
    mi : module
        Mitsuba.
    normal, v : mitsuba.Vector3f
        Shading normal, and the direction towards the viewer.
    f0 : mitsuba.Color3f
        Reflectance at normal incidence.
    roughness : mitsuba.Float
        Perceptual; alpha is its square.
    """

    def __init__(self, mi: Any, normal: Any, v: Any, f0: Any, roughness: Any) -> None:
        self._mi, self._frame, self._f0 = mi, mi.Frame3f(normal), f0
        self._alpha = dr.maximum(roughness * roughness, MIN_ALPHA)
        v = self._frame.to_local(v)
        self._v = dr.normalize(mi.Vector3f(v.x, v.y, dr.maximum(v.z, MIN_COSINE)))
        self.roughness, self._once = roughness, lobe_albedo(self._alpha, self._v.z)
        self._compensation = multiple_scattering(f0, self._once)

    def sample(self, u: Any) -> Any:
        """``v`` reflected at a visible microfacet (Heitz 2018, "Sampling the GGX Distribution of Visible Normals")."""
        v, alpha, vector = self._v, self._alpha, self._mi.Vector3f
        stretched = dr.normalize(vector(alpha * v.x, alpha * v.y, v.z))
        square = stretched.x * stretched.x + stretched.y * stretched.y
        inverse = dr.rsqrt(dr.maximum(square, 1e-12))
        across = dr.select(square > 1e-12, vector(-stretched.y * inverse, stretched.x * inverse, 0), vector(1, 0, 0))
        radius, phi, share = dr.sqrt(u.x), 2 * dr.pi * u.y, 0.5 * (1 + stretched.z)
        a = radius * dr.cos(phi)
        b = dr.lerp(dr.sqrt(dr.maximum(1 - a * a, 0)), radius * dr.sin(phi), share)
        up = dr.sqrt(dr.maximum(1 - a * a - b * b, 0))
        h = a * across + b * dr.cross(stretched, across) + up * stretched
        h = dr.normalize(vector(alpha * h.x, alpha * h.y, dr.maximum(h.z, 1e-6)))
        return self._frame.to_world(2 * dr.dot(v, h) * h - v)

    def pdf(self, l: Any) -> Any:  # noqa: E741
        """Density of ``sample``, per steradian."""
        n_v, a2 = self._v.z, self._alpha * self._alpha
        masking = 2 * n_v / (n_v + dr.sqrt(a2 + (1 - a2) * n_v * n_v))
        return self._distribution(self._half(l)) * masking / (4 * n_v)

    def eval(self, l: Any) -> Any:  # noqa: E741
        """The lobe without the Fresnel factor, times the cosine of ``l``; 0 below the horizon."""
        n_l, n_v, a2 = self._frame.to_local(l).z, self._v.z, self._alpha * self._alpha
        smith = n_l * dr.sqrt(n_v * n_v * (1 - a2) + a2) + n_v * dr.sqrt(n_l * n_l * (1 - a2) + a2)
        lobe = self._distribution(self._half(l)) * 0.5 / dr.maximum(smith, 1e-6)
        return dr.select(n_l > 0, lobe * n_l, 0)

    def tint(self, l: Any) -> Any:  # noqa: E741
        """The Fresnel factor by Schlick's approximation, with light that is scattered more than once."""
        cosine = dr.clip(dr.dot(self._half(l), self._v), 0, 1)
        return self._compensation * (self._f0 + (1 - self._f0) * dr.power(1 - cosine, 5))

    def reflectance(self) -> Any:
        """Mean of ``tint`` over what the lobe without it reflects; nothing where F0 is 0."""
        fresnel = dr.clip(lobe_fresnel(self.roughness, self._alpha, self._v.z), 0, 1)
        return dr.select(dr.max(self._f0) > 0, self._compensation * (self._f0 + (1 - self._f0) * fresnel), 0)

    def albedo(self) -> Any:
        """Share of light from everywhere that is reflected, by the fit of ``app.specular_albedo``."""
        return self._once * self.reflectance()

    def _half(self, l: Any) -> Any:  # noqa: E741
        return dr.normalize(self._frame.to_local(l) + self._v)

    def _distribution(self, h: Any) -> Any:
        """Density of microfacet normals (Trowbridge and Reitz 1975)."""
        a2 = self._alpha * self._alpha
        q = a2 * h.z * h.z + h.x * h.x + h.y * h.y  # precise for smooth surfaces, too
        return dr.select(h.z > 0, a2 / (dr.pi * q * q), 0)
