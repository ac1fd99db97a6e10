"""Textures for scattered rays: blurred colour, sharp alpha."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.arrays import F32, Bytes
from app.io.image import srgb_decode
from app.network.channels import HALF_MAX
from app.scene import Texture

MAX_SIDE = 64  # texels; one of many rays stands for a cone, which resolves no finer detail


def sample_nearest(texture: Texture, uv: F32) -> F32:
    """The nearest texels, shape (N, 4), unfiltered; alpha linear in [0, 1], colour as it is stored."""
    texels = _nearest(texture.pixels, texture, uv)
    return texels.astype(np.float32) / np.float32(255) if texels.dtype == np.uint8 else texels


class PrefilteredTextures:
    """Blurred copies of textures, each made when it is first sampled."""

    def __init__(self) -> None:
        self._copies: dict[tuple[int, bool, bool], F32] = {}

    def sample(self, texture: Texture, uv: F32, alpha_tested: bool = False) -> F32:
        """Linear colour, shape (N, 3), at mesh coordinates ``uv``, shape (N, 2).

        When ``alpha_tested``, texels count by their alpha, so that cut-out ones do not bleed into the mean.
        """
        color: F32 = _nearest(self.copy_of(texture, alpha_tested), texture, uv)
        return color

    def copy_of(self, texture: Texture, alpha_tested: bool = False) -> F32:
        """The texels that ``sample`` takes, shape (h, w, 3), top row first."""
        key = id(texture.pixels), alpha_tested, texture.is_color  # the scene keeps the pixels, so the id stays theirs
        if key not in self._copies:
            self._copies[key] = _blur(texture, alpha_tested)
        return self._copies[key]


def _blur(texture: Texture, alpha_tested: bool) -> F32:
    """Linear means over blocks, at most ``MAX_SIDE`` a side; weighted by alpha when ``alpha_tested``."""
    pixels = texture.pixels
    linear = _linear(pixels[..., :3], texture.is_color)
    weight = np.nan_to_num(pixels[..., 3:].astype(np.float64)).clip(1e-6, 255) if alpha_tested else np.ones((1, 1, 1))
    weighted = np.concatenate([linear * weight, np.broadcast_to(weight, (*linear.shape[:2], 1))], axis=-1)
    for axis in (0, 1):
        edges = np.linspace(0, weighted.shape[axis], min(MAX_SIDE, weighted.shape[axis]) + 1).astype(int)
        weighted = np.add.reduceat(weighted, edges[:-1], axis=axis)
    mean: F32 = (weighted[..., :3] / weighted[..., 3:]).astype(np.float32)
    return mean


def _linear(color: Bytes | F32, is_color: bool) -> F32:
    if color.dtype != np.uint8:
        return np.asarray(np.nan_to_num(color, posinf=HALF_MAX, neginf=0).clip(0, HALF_MAX))
    share = np.arange(256, dtype=np.float32) / np.float32(255)
    return np.asarray((srgb_decode(share) if is_color else share)[color])


def _nearest(pixels: NDArray[Any], texture: Texture, uv: F32) -> NDArray[Any]:
    transform = np.asarray(texture.transform, np.float64)
    at = uv @ transform[:2, :2].T + transform[:2, 2]
    height, width = pixels.shape[:2]
    index = []
    for value, size, repeat in ((1 - at[:, 1], height, texture.repeat[1]), (at[:, 0], width, texture.repeat[0])):
        value = value - np.floor(value) if repeat else value
        index.append(np.clip((value * size).astype(np.int64), 0, size - 1))
    texels: NDArray[Any] = pixels.reshape(-1, pixels.shape[2]).take(index[0] * width + index[1], axis=0)
    return texels
