"""Textures as scattered rays see them: their colour blurred, their alpha as sharp as it is drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.io.image import srgb_decode
from app.network.channels import HALF_MAX
from app.scene import Texture

F32 = NDArray[np.float32]

SIDE = 64  # texels along the longer edge; a ray of many stands for a cone, which sees no finer detail


def texels(texture: Texture, uv: F32) -> F32:
    """The nearest texels as they are, shape (N, 4); alpha linear in [0, 1], colour as it is stored."""
    found = _nearest(texture.pixels, texture, uv)
    return found.astype(np.float32) / np.float32(255) if found.dtype == np.uint8 else found


class Prefiltered:
    """Keeps a blurred copy of each texture that it is asked for."""

    def __init__(self) -> None:
        self._copies: dict[tuple[int, bool], F32] = {}

    def color(self, texture: Texture, uv: F32, masked: bool = False) -> F32:
        """Linear colour, shape (N, 3), at mesh coordinates ``uv``, shape (N, 2); of what shows, when ``masked``."""
        key = id(texture.pixels), masked  # which the scene keeps
        if key not in self._copies:
            self._copies[key] = _blurred(texture.pixels, masked)
        found: F32 = _nearest(self._copies[key], texture, uv)
        return found


def _blurred(pixels: NDArray[np.uint8] | F32, masked: bool) -> F32:
    """Means over blocks, at most ``SIDE`` a side, linear; weighted by alpha when ``masked``."""
    color = pixels[..., :3]
    linear = srgb_decode(color / np.float32(255)) if pixels.dtype == np.uint8 else np.nan_to_num(
        color, posinf=HALF_MAX, neginf=0).clip(0, HALF_MAX)
    share = np.nan_to_num(pixels[..., 3:].astype(np.float64)).clip(1e-6, 255) if masked else np.ones((1, 1, 1))
    weighted = np.concatenate([linear * share, np.broadcast_to(share, (*linear.shape[:2], 1))], axis=-1)
    for axis in (0, 1):
        edges = np.linspace(0, weighted.shape[axis], min(SIDE, weighted.shape[axis]) + 1).astype(int)
        weighted = np.add.reduceat(weighted, edges[:-1], axis=axis)
    mean: F32 = (weighted[..., :3] / weighted[..., 3:]).astype(np.float32)
    return mean


def _nearest(pixels: NDArray[Any], texture: Texture, uv: F32) -> NDArray[Any]:
    transform = np.asarray(texture.transform, np.float64)
    at = uv @ transform[:2, :2].T + transform[:2, 2]
    height, width = pixels.shape[:2]
    index = []
    for value, size, repeat in ((1 - at[:, 1], height, texture.repeat[1]), (at[:, 0], width, texture.repeat[0])):
        value = value - np.floor(value) if repeat else value
        index.append(np.clip((value * size).astype(np.int64), 0, size - 1))
    return pixels[index[0], index[1]]
