"""A pyramid over what is behind rough glass: light, and how near the nearest opaque surface is."""

import moderngl

from app.gl.compute import run_over_grid
from app.gl.context import Device

LEVELS = 8
GROUP = 8  # side of a work group of blur_levels.comp, in texels


class BlurLevels:
    """Coarser levels of a picture of a width and height: texels of level k are 2^(k + 1) pixels wide.

    The driver's mipmaps leave rows out, or count them twice, where a side is odd; these lose no light.

    Attributes
    ----------
    light : Texture
        Linear radiance times the share of the texel that is inside the picture, and that share.
    depth : Texture
        Of the nearest opaque surface; very large where there is none.
    """

    def __init__(self, device: Device, size: tuple[int, int]) -> None:
        coarsest = 2**LEVELS
        padded = [-(-side // coarsest) * coarsest // 2 for side in size]
        self._device, self._size = device, (padded[0], padded[1])
        self.light = device.ctx.texture(self._size, 4, dtype="f2")
        self.depth = device.ctx.texture(self._size, 1, dtype="f4")
        for texture in (self.light, self.depth):
            texture.build_mipmaps(0, LEVELS - 1)  # which allocates the levels
            texture.repeat_x = texture.repeat_y = False
        self.light.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
        self.depth.filter = moderngl.NEAREST_MIPMAP_NEAREST, moderngl.NEAREST

    def build(self, light: moderngl.Texture, depth: moderngl.Texture) -> None:
        """From linear radiance, and from depths of opaque surfaces, which are 0 where there is none."""
        for level in range(LEVELS):
            program = self._device.program("blur_levels.comp", defines={} if level else {"FINEST": 1})
            below = (self.light, self.depth) if level else (light, depth)
            program.set(below=max(level - 1, 0))
            run_over_grid(self._device, program, (self._size[0] >> level, self._size[1] >> level), GROUP,
                          {"below_light": below[0], "below_depth": below[1]}, (self.light, self.depth), level)
