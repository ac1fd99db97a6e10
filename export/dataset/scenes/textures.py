"""Small procedural textures: shares of a material's colour, tiling without seams."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from app.io.image import srgb_encode, to_8bit
from app.scene import Texture
from export.dataset.scenes.generated_scene import Rng

F64 = NDArray[np.float64]

TEXELS = 64
DEEPEST = 0.75  # of the colour that the darkest texels lose


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
    """Rows of bricks of differing shades, every other row shifted, with darker joints."""
    rows, columns = 2 * int(rng.integers(2, 5)), int(rng.integers(2, 5))
    y, x = np.mgrid[:TEXELS, :TEXELS] / TEXELS
    row = (y * rows).astype(int)
    shifted = (x * columns + 0.5 * (row % 2)) % columns
    shade = rng.uniform(0.5, 1.0, (rows, columns))[row, shifted.astype(int)]
    joint = (y * rows % 1 < 0.12) | (shifted % 1 < 0.08)
    return np.where(joint, rng.uniform(0.0, 0.6), shade)


def planks(rng: Rng) -> F64:
    """Boards of differing shades, with grain along them."""
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


KINDS: tuple[Callable[[Rng], F64], ...] = (checker, noise, bricks, planks, stripes)


def random_texture(rng: Rng, metres: float) -> Texture:
    """A texture of a random kind that repeats after ``metres``."""
    pattern = KINDS[rng.integers(len(KINDS))](rng)
    tint = rng.uniform(0.8, 1.0, 3)  # dark and light texels differ a little in hue
    shares = 1 - rng.uniform(0.2, DEEPEST) * (1 - pattern[..., None]) * tint
    shares = np.round(255 * shares) / 255  # or machines would round a few texels in different ways
    pixels = np.concatenate([to_8bit(srgb_encode(shares)), np.full((TEXELS, TEXELS, 1), 255, np.uint8)], axis=2)
    return Texture(pixels, np.diag([1 / metres, 1 / metres, 1.0]))
