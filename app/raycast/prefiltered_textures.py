"""Textures for rays: colour as blurred as the cone that a ray stands for, sharp alpha."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.arrays import F32, F64, Bools, Bytes, Ints
from app.io.image import srgb_decode
from app.network.channels import HALF_MAX
from app.scene import Texture

MAX_SIDE = 64  # texels, for scattered rays: one of many stands for a cone, which resolves no finer detail
MAX_SHARP_SIDE = 512  # texels, for rays that have a width


def sample_nearest(texture: Texture, uv: F32) -> F32:
    """The nearest texels, shape (N, 4), unfiltered; alpha linear in [0, 1], colour as it is stored."""
    texels = _nearest(texture.pixels, texture, uv)
    return texels.astype(np.float32) / np.float32(255) if texels.dtype == np.uint8 else texels


class PrefilteredTextures:
    """Blurred copies of textures, each made when it is first sampled."""

    def __init__(self) -> None:
        self._copies: dict[tuple[int, bool, bool], F32] = {}
        self._pyramids: dict[tuple[int, bool, bool], _Pyramid] = {}

    def sample(self, texture: Texture, uv: F32, alpha_tested: bool = False, width: F32 | None = None) -> F32:
        """Linear colour, shape (N, 3), at mesh coordinates ``uv``, shape (N, 2).

        When ``alpha_tested``, texels count by their alpha, so that cut-out ones do not bleed into the mean.

        Parameters
        ----------
        width : ndarray, float32, shape (N, 2), optional
            Of what is averaged, along both mesh coordinates; default that of scattered rays.
        """
        if width is None:
            color: F32 = _nearest(self.copy_of(texture, alpha_tested), texture, uv)
            return color
        key = _key(texture, alpha_tested)
        if key not in self._pyramids:
            dtype = np.float16 if texture.pixels.dtype == np.uint8 else np.float32
            self._pyramids[key] = _Pyramid(_blur(texture, alpha_tested, MAX_SHARP_SIDE), dtype)
        return self._pyramids[key].sample(texture, uv, width)

    def copy_of(self, texture: Texture, alpha_tested: bool = False) -> F32:
        """The texels of scattered rays, shape (h, w, 3), top row first."""
        key = _key(texture, alpha_tested)
        if key not in self._copies:
            weighted = _blur(texture, alpha_tested, MAX_SIDE)
            self._copies[key] = (weighted[..., :3] / weighted[..., 3:]).astype(np.float32)
        return self._copies[key]


class _Pyramid:
    """A mip pyramid, sampled with bilinear weights in the level whose texels are about as wide as a ray.

    Parameters
    ----------
    finest : ndarray, float64, shape (h, w, 4)
        Linear colour times its weight, and that weight; top row first.
    dtype : type
        Of the texels.
    """

    def __init__(self, finest: F64, dtype: type) -> None:
        levels = [finest]
        while max(levels[-1].shape[:2]) > 1:
            levels.append(_block_sums(levels[-1], tuple((side + 1) // 2 for side in levels[-1].shape[:2])))
        self._sizes = np.array([level.shape[:2] for level in levels])
        self._starts = np.cumsum([0, *(height * width for height, width in self._sizes[:-1])])
        self._texels = np.concatenate([(level[..., :3] / level[..., 3:]).reshape(-1, 3).astype(dtype)
                                       for level in levels])

    def sample(self, texture: Texture, uv: F32, width: F32) -> F32:
        """Linear colour, shape (N, 3), at mesh coordinates and averaged over widths along both, shape (N, 2)."""
        turned = np.square(np.asarray(texture.transform, np.float64)[:2, :2])
        across = np.sqrt(np.square(np.nan_to_num(width.astype(np.float64))) @ turned.T) * self._sizes[0, ::-1]
        texels = across.max(axis=1)  # of the finest level
        level = np.rint(np.log2(texels.clip(1, self._sizes[0].max()))).astype(np.int64).clip(max=len(self._sizes) - 1)
        is_nearest = (texels < 1) & (texture.magnified == "nearest")
        size, start = self._sizes.take(level, axis=0), self._starts.take(level)
        at = _transformed(texture, uv)
        rows = _neighbours(1 - at[:, 1], size[:, 0], texture.repeat[1], is_nearest)
        columns = _neighbours(at[:, 0], size[:, 1], texture.repeat[0], is_nearest)
        color = np.zeros((len(uv), 3), np.float32)
        for row, of_row in rows:
            for column, of_column in columns:
                texels = self._texels.take(start + row * size[:, 1] + column, axis=0)
                color += (of_row * of_column).astype(np.float32)[:, None] * texels
        return color


def _key(texture: Texture, alpha_tested: bool) -> tuple[int, bool, bool]:
    return id(texture.pixels), alpha_tested, texture.is_color  # the scene keeps the pixels, so the id stays theirs


def _blur(texture: Texture, alpha_tested: bool, max_side: int) -> F64:
    """Weighted linear colour over blocks, at most ``max_side`` a side, and the weights, shape (h, w, 4).

    These are alphas when ``alpha_tested``.
    """
    pixels = texture.pixels
    color, weight = _linear(pixels[..., :3], texture.is_color), np.ones((*pixels.shape[:2], 1), np.float32)
    if alpha_tested:
        weight = np.nan_to_num(pixels[..., 3:].astype(np.float32)).clip(1e-6, 255)
        color = color * weight
    height, width = pixels.shape[:2]
    size = min(max_side, height), min(max_side, width)
    return np.concatenate([_block_sums(values, size) for values in (color, weight)], axis=-1)


def _block_sums(values: NDArray[Any], size: tuple[int, ...]) -> F64:
    """Sums over ``size`` blocks of rows and columns that share them evenly."""
    for axis, count in enumerate(size):
        edges = np.linspace(0, values.shape[axis], count + 1).astype(int)
        values = np.add.reduceat(values, edges[:-1], axis=axis, dtype=np.float64)
    return values


def _linear(color: Bytes | F32, is_color: bool) -> F32:
    if color.dtype != np.uint8:
        return np.asarray(np.nan_to_num(color, posinf=HALF_MAX, neginf=0).clip(0, HALF_MAX))
    share = np.arange(256, dtype=np.float32) / np.float32(255)
    return np.asarray((srgb_decode(share) if is_color else share)[color])


def _nearest(pixels: NDArray[Any], texture: Texture, uv: F32) -> NDArray[Any]:
    at = _transformed(texture, uv)
    height, width = pixels.shape[:2]
    index = []
    for value, size, repeat in ((1 - at[:, 1], height, texture.repeat[1]), (at[:, 0], width, texture.repeat[0])):
        value = value - np.floor(value) if repeat else value
        index.append(np.clip((value * size).astype(np.int64), 0, size - 1))
    texels: NDArray[Any] = pixels.reshape(-1, pixels.shape[2]).take(index[0] * width + index[1], axis=0)
    return texels


def _neighbours(value: F64, size: Ints, repeat: bool, is_nearest: Bools) -> list[tuple[Ints, F64]]:
    """The two texels around coordinates in [0, 1] of rows of ``size``, and their weights, shape (N,).

    These are bilinear, or 1 for the nearest one where ``is_nearest``.
    """
    at = np.asarray((value - np.floor(value) if repeat else value.clip(0, 1)) * size - 0.5, np.float64)
    low = np.floor(at)
    share = np.where(is_nearest, at - low >= 0.5, at - low)
    both = (low.astype(np.int64), 1 - share), (low.astype(np.int64) + 1, share)
    return [(texel % size if repeat else texel.clip(0, size - 1), weight) for texel, weight in both]


def _transformed(texture: Texture, uv: F32) -> F64:
    """Texture coordinates at mesh coordinates, shape (N, 2)."""
    transform = np.asarray(texture.transform, np.float64)
    return np.asarray(uv @ transform[:2, :2].T + transform[:2, 2])
