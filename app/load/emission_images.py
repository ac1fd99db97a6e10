"""How the emission of textured rectangles varies over them."""

from dataclasses import replace

import numpy as np

from app.arrays import F64
from app.load.emission import SurfaceEmission
from app.scene import EmissionImage, RectLight

MAX_FACTOR = 6e4      # that half floats can hold
MIN_CONTRAST = 0.02   # deviation from the mean, below which an image is not worth its time


def with_image(light: RectLight, corners: F64, uvs: F64, emission: SurfaceEmission) -> RectLight:
    """A light with the image of its surface, unless this is the same everywhere.

    Parameters
    ----------
    corners : ndarray, float64, shape (T, 3, 3)
        Triangles that fill the rectangle, but for a hundredth of it, in the light's space.
    uvs : ndarray, float64, shape (2, T, 3, 2)
        Texture coordinates at their corners, in both sets.
    """
    side = EmissionImage.SIDE
    radiance = np.zeros((side, side, 3))
    texels = float(emission.texels(uvs).sum())
    level = int(np.ceil(np.log2(max(texels / side**2, 1)) / 2))
    edges = np.stack([light.edge_u, light.edge_v])
    # In units of the texels, whose centres are at whole numbers.
    places = ((corners - light.center) @ edges.T / np.square(edges).sum(axis=1) + 0.5) * side - 0.5
    for triangle, of_triangle in zip(places, np.moveaxis(uvs, 1, 0), strict=True):
        low = np.ceil(triangle.min(axis=0)).clip(0, side).astype(np.int64)
        high = np.floor(triangle.max(axis=0)).clip(-1, side - 1).astype(np.int64) + 1
        x, y = (grid.ravel() for grid in np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1])))
        shares = _barycentric(triangle, np.stack([x, y], axis=1).astype(np.float64))
        inside = shares.min(axis=1, initial=1.0) >= -1e-9
        at = np.einsum("nk,ukd->und", shares[inside], of_triangle)
        radiance[y[inside], x[inside]] = emission.at(at, level)
    mean = radiance.mean(axis=(0, 1))
    pixels = np.where(mean > 0, radiance / np.maximum(mean, 1e-300), 1.0).clip(0, MAX_FACTOR).astype(np.float32)
    return light if pixels.std(axis=(0, 1)).max() < MIN_CONTRAST else replace(light, image=EmissionImage(pixels))


def _barycentric(triangle: F64, at: F64) -> F64:
    """Shares of three corners, shape (3, 2), at N places, shape (N, 2); outside of an empty one. Shape (N, 3)."""
    (x, y), (z, w) = triangle[1:] - triangle[0]
    area = x * w - y * z
    if area == 0:
        return np.full((len(at), 3), -1.0)
    dx, dy = (at - triangle[0]).T
    b, c = (dx * w - dy * z) / area, (dy * x - dx * y) / area
    return np.stack([1 - b - c, b, c], axis=1)
