"""Random materials. Furnished rooms have a mean albedo of 0.4 to 0.7: walls and ceilings are light, objects are not."""

import colorsys
from collections.abc import Callable
from functools import partial

import numpy as np

from app.arrays import F64
from app.io.image import srgb_encode, to_8bit
from app.scene import Material, Texture
from export.dataset.scenes.generated_scene import Rng

Color = tuple[float, float, float]

MAX_ALBEDO = 0.92
TEXELS = 64           # along each side of a texture
MAX_DARKENING = 0.75  # of the albedo by a texture


def random_color(rng: Rng, low: float, high: float, saturated: float = 0.2) -> Color:
    """A colour with largest component between ``low`` and ``high``: pale, or with probability ``saturated`` strong."""
    saturation = rng.uniform(0.5, 1.0) if rng.random() < saturated else rng.beta(1.2, 4.0)
    return colorsys.hsv_to_rgb(rng.random(), float(saturation), float(rng.uniform(low, high)))


def random_material(rng: Rng, low: float = 0.15, high: float = 0.9, textured: float = 0.35, metres: float = 1.0,
                    saturated: float = 0.2) -> Material:
    """A diffuse material whose largest albedo component is between ``low`` and ``high``.

    Parameters
    ----------
    textured, saturated : float
        Probabilities of a texture and of a strong colour.
    metres : float
        Approximate period of textures.
    """
    albedo = random_color(rng, low, min(high, MAX_ALBEDO), saturated)
    texture = random_texture(rng, metres * rng.uniform(0.5, 2.0)) if rng.random() < textured else None
    return Material("surface", albedo=albedo, albedo_map=texture)


wall_material = partial(random_material, low=0.5, high=0.92, textured=0.3, metres=1.5, saturated=0.1)
ceiling_material = partial(random_material, low=0.6, high=0.92, textured=0.1, metres=2.0, saturated=0.05)
floor_material = partial(random_material, low=0.15, high=0.8, textured=0.7, metres=1.5, saturated=0.12)
furniture_material = partial(random_material, low=0.05, high=0.92, textured=0.3, metres=0.5)


def emissive_material(radiance: Color) -> Material:
    """A material that emits on both sides."""
    return Material("glow", albedo=(0.6, 0.6, 0.6), emission=radiance)  # the name is part of scene keys


def checker(rng: Rng) -> F64:
    """Squares of two shades."""
    n = int(rng.integers(1, 4))
    cell = np.arange(TEXELS) * 2 * n // TEXELS
    return ((cell[:, None] + cell) % 2).astype(np.float64)


def noise(rng: Rng) -> F64:
    """Blurred random values of several octaves."""
    total = np.zeros((TEXELS, TEXELS))
    for octave in range(2, 6):
        n = 2**octave
        values = np.repeat(np.repeat(rng.random((n, n)), TEXELS // n, 0), TEXELS // n, 1)
        for axis in (0, 1):
            for shift in range(1, TEXELS // n // 2 + 1):
                values = (values + np.roll(values, shift, axis) + np.roll(values, -shift, axis)) / 3
        total += values / octave
    return (total - total.min()) / np.ptp(total)


def bricks(rng: Rng) -> F64:
    """Rows of bricks of varying shades, every other row shifted, with darker joints."""
    rows, columns = 2 * int(rng.integers(2, 5)), int(rng.integers(2, 5))
    y, x = np.mgrid[:TEXELS, :TEXELS] / TEXELS
    row = (y * rows).astype(int)
    shifted = (x * columns + 0.5 * (row % 2)) % columns
    shade = rng.uniform(0.5, 1.0, (rows, columns))[row, shifted.astype(int)]
    joint = (y * rows % 1 < 0.12) | (shifted % 1 < 0.08)
    return np.where(joint, rng.uniform(0.0, 0.6), shade)


def planks(rng: Rng) -> F64:
    """Boards of varying shades, with grain along them."""
    count = int(rng.integers(3, 8))
    y, x = np.mgrid[:TEXELS, :TEXELS] / TEXELS
    board = (y * count).astype(int)
    waves = np.sin(2 * np.pi * (rng.integers(1, 4, count)[board] * x + 3 * y * count + rng.random(count)[board]))
    shade = rng.uniform(0.4, 1.0, count)[board] + 0.12 * waves
    return np.clip(np.where(y * count % 1 < 0.08, 0.1, shade), 0.0, 1.0)


def stripes(rng: Rng) -> F64:
    """Bands of two shades."""
    n = int(rng.integers(2, 8))
    band = (np.arange(TEXELS) * n / TEXELS % 1 < rng.uniform(0.2, 0.8)).astype(np.float64)
    return np.broadcast_to(band, (TEXELS, TEXELS))


PATTERNS: tuple[Callable[[Rng], F64], ...] = (checker, noise, bricks, planks, stripes)


def random_texture(rng: Rng, metres: float) -> Texture:
    """A texture of a random pattern, which tiles without seams, with a period of ``metres``: factors of the albedo."""
    pattern = PATTERNS[rng.integers(len(PATTERNS))](rng)
    tint = rng.uniform(0.8, 1.0, 3)  # dark and light texels differ slightly in hue
    factors = 1 - rng.uniform(0.2, MAX_DARKENING) * (1 - pattern[..., None]) * tint
    factors = np.round(255 * factors) / 255  # otherwise machines round a few texels differently
    pixels = np.concatenate([to_8bit(srgb_encode(factors)), np.full((TEXELS, TEXELS, 1), 255, np.uint8)], axis=2)
    return Texture(pixels, np.diag([1 / metres, 1 / metres, 1.0]))
