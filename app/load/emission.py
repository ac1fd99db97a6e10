"""What a surface emits on the mean."""

import numpy as np

from app.arrays import F64
from app.load.images import mean_color
from app.scene import Material

OPAQUE = 255  # of alpha in 8 bits


def mean_radiance(material: Material) -> F64:
    """Mean emitted radiance of what a material covers of its surface, shape (3,), W/(sr m²)."""
    radiance = np.asarray(material.emission) * _coverage(material)
    return radiance if material.emission_map is None else radiance * mean_color(material.emission_map.pixels)


def _coverage(material: Material) -> float:
    """The mean share of the surface that a blended or alpha-tested material covers."""
    if not material.is_blended and material.alpha_cutoff is None:
        return 1.0
    alpha = np.full((1, 1), material.alpha)
    if material.albedo_map is not None:
        pixels = material.albedo_map.pixels
        alpha = alpha * pixels[..., 3] / (OPAQUE if pixels.dtype == np.uint8 else 1)
    return float(np.mean(alpha if material.alpha_cutoff is None else alpha >= material.alpha_cutoff))
