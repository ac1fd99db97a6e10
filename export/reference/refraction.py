"""Light that passes a rough surface (KHR_materials_transmission, KHR_materials_volume)."""

from typing import Any

import drjit as dr

from export.reference.ggx import GgxLobe


def transmitted(mi: Any, normal: Any, v: Any, roughness: Any, ior: Any, is_thick: Any, u: Any) -> tuple[Any, Any]:
    """A direction behind the surface, sampled by the lobe, and its weight without the Fresnel factor.

    A thin wall mirrors the lobe of reflections at its plane; a volume refracts at the microfacets.

    Parameters
    ----------
    normal, v : mitsuba.Vector3f
        Shading normal, and the direction towards the viewer, on the same side.
    ior : mitsuba.Float
        Of what lies behind the surface relative to what lies before it.
    """
    lobe = GgxLobe(mi, normal, v, mi.Color3f(1.0), roughness)
    mirrored = lobe.sample(u)
    weight = lobe.eval(mirrored) / dr.maximum(lobe.pdf(mirrored), 1e-12)
    h = dr.normalize(mirrored + v)
    thin = mirrored - 2 * dr.dot(mirrored, normal) * normal
    return dr.select(is_thick, refract(v, h, ior), thin), weight


def refract(v: Any, h: Any, ior: Any) -> Any:
    """The direction that light from ``v`` takes behind a plane of the normal ``h``; mirrored where none can pass."""
    cosine = dr.dot(v, h)
    square = 1 - (1 - cosine * cosine) / (ior * ior)
    passed = (cosine / ior - dr.safe_sqrt(square)) * h - v / ior
    return dr.select(square > 0, passed, 2 * cosine * h - v)
