"""All textures of a scene in one array, looked up by index: each ray may meet another texture."""

from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from app.arrays import F32
from app.io.image import srgb_decode
from app.scene import Texture

HALF_MAX = 65504.0
_WHITE = Texture(np.ones((1, 1, 4), np.float32))


def linear_pixels(texture: Texture) -> F32:
    """Linear float32, shape (H, W, 4)."""
    if texture.pixels.dtype != np.uint8:
        return np.nan_to_num(texture.pixels.astype(np.float32), nan=0, posinf=HALF_MAX, neginf=0).clip(0, HALF_MAX)
    pixels: F32 = texture.pixels.astype(np.float32) / np.float32(255)
    if not texture.is_color:
        return pixels
    pixels[..., :3] = srgb_decode(pixels[..., :3])
    return pixels


class TextureTable:
    """Textures by index; number 0 is white.

    Parameters
    ----------
    mi : module
        Mitsuba.
    textures : sequence of Texture
        Indices begin at 1.
    """

    def __init__(self, mi: Any, textures: Sequence[Texture]) -> None:
        from drjit.llvm import ad

        self._mi, self._texel = mi, ad.Array4f16
        texels: list[NDArray[np.float16]] = []
        offsets: dict[tuple[int, bool], int] = {}
        count = 0
        rows = []
        for texture in (_WHITE, *textures):
            key = id(texture.pixels), texture.is_color
            height, width = texture.pixels.shape[:2]
            if key not in offsets:
                offsets[key] = count
                texels.append(linear_pixels(texture).astype(np.float16).ravel())
                count += width * height
            rows.append((offsets[key], width, height, texture.magnified == "nearest", *texture.repeat, texture.uv_set))
        self._texels = ad.Float16(np.concatenate(texels))
        self._records = [mi.UInt32(np.array(column, np.uint32)) for column in zip(*rows, strict=True)]
        self._transforms = [mi.Float(np.array(column, np.float32)) for column in zip(
            *(t.transform[:2].ravel() for t in (_WHITE, *textures)), strict=True)]

    def lookup(self, index: Any, uvs: Any, second_uvs: Any, active: Any) -> Any:
        """Linear RGBA, mitsuba.Vector4f, at coordinates of the mesh whose v grows upwards."""
        mi = self._mi
        offset, width, height, nearest, repeat_u, repeat_v, uv_set = (
            dr.gather(mi.UInt32, column, index, active) for column in self._records)
        a, b, c, d, e, f = (dr.gather(mi.Float, column, index, active) for column in self._transforms)
        at = dr.select(uv_set == 1, second_uvs, uvs)
        x, tx = self._texels_along(a * at.x + b * at.y + c, width, nearest > 0, repeat_u > 0)
        y, ty = self._texels_along(1 - (d * at.x + e * at.y + f), height, nearest > 0, repeat_v > 0)
        rows = []
        for row in y:
            left, right = (mi.Vector4f(dr.gather(self._texel, self._texels, offset + mi.UInt32(row) * width
                                                 + mi.UInt32(column), active)) for column in x)
            rows.append(dr.lerp(left, right, tx))
        return dr.lerp(rows[0], rows[1], ty)

    def _texels_along(self, at: Any, size: Any, nearest: Any, repeat: Any) -> tuple[tuple[Any, Any], Any]:
        """Indices of the two texels beside ``at`` along one axis, and the share of the second."""
        mi = self._mi
        size = mi.Int32(size)
        position = dr.select(repeat, at - dr.floor(at), dr.clip(at, 0, 1)) * mi.Float(size)
        position -= dr.select(nearest, 0.0, 0.5)
        first = mi.Int32(dr.floor(position))
        share = dr.select(nearest, 0.0, position - mi.Float(first))

        def wrap(i: Any) -> Any:
            around = dr.select(i < 0, i + size, dr.select(i >= size, i - size, i))
            return dr.clip(dr.select(repeat, around, i), 0, size - 1)

        return (wrap(first), wrap(first + 1)), share
