"""Random materials. The mean albedo of furnished rooms is 0.4 to 0.7 (walls and ceilings are light, things are not)."""

from __future__ import annotations

import colorsys

from app.scene import Material
from export.dataset.scenes.generated_scene import Rng
from export.dataset.scenes.textures import random_texture

Color = tuple[float, float, float]

BRIGHTEST = 0.92


def color(rng: Rng, low: float, high: float, saturated: float = 0.2) -> Color:
    """A colour whose largest component is between ``low`` and ``high``: pale, or ``saturated`` so often."""
    saturation = rng.uniform(0.5, 1.0) if rng.random() < saturated else rng.beta(1.2, 4.0)
    return colorsys.hsv_to_rgb(rng.random(), float(saturation), float(rng.uniform(low, high)))


def random_material(rng: Rng, low: float = 0.15, high: float = 0.9, textured: float = 0.35, metres: float = 1.0,
                    saturated: float = 0.2) -> Material:
    """A surface whose brightest component is between ``low`` and ``high``.

    Parameters
    ----------
    textured : float
        How often there is a texture.
    metres : float
        After which textures repeat, about.
    saturated : float
        How often the colour is strong.
    """
    shade = color(rng, low, min(high, BRIGHTEST), saturated)
    texture = random_texture(rng, metres * rng.uniform(0.5, 2.0)) if rng.random() < textured else None
    return Material("surface", albedo=shade, albedo_map=texture)


def wall(rng: Rng) -> Material:
    return random_material(rng, 0.5, 0.92, textured=0.3, metres=1.5, saturated=0.1)


def ceiling(rng: Rng) -> Material:
    return random_material(rng, 0.6, 0.92, textured=0.1, metres=2.0, saturated=0.05)


def floor(rng: Rng) -> Material:
    return random_material(rng, 0.15, 0.8, textured=0.7, metres=1.5, saturated=0.12)


def thing(rng: Rng) -> Material:
    """Furniture: anything from almost black to almost white."""
    return random_material(rng, 0.05, 0.92, textured=0.3, metres=0.5)


def glowing(radiance: Color) -> Material:
    """Shines on both sides and lights what is around it."""
    return Material("glow", albedo=(0.6, 0.6, 0.6), emission=radiance)
