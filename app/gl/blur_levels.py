"""A pyramid over what is behind rough glass: light, and how near the nearest opaque surface is."""

import moderngl

from app.gl.compute import run_over_grid
from app.gl.context import Device

LEVELS = 8
GROUP = 8  # side of a work group of blur_levels.comp, in texels


class BlurLevels:
    """Coarser levels of a picture of a width and height, side by side in one texture, see blur_level.glsl.

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
        self._device = device
        self._finest = tuple(-(-side // coarsest) * coarsest // 2 for side in size)
        both = self._finest[0] * 3 // 2, self._finest[1]
        self.light, self.depth = device.ctx.texture(both, 4, dtype="f2"), device.ctx.texture(both, 1, dtype="f4")

    def build(self, light: moderngl.Texture, depth: moderngl.Texture) -> None:
        """From linear radiance, and from depths of opaque surfaces, which are 0 where there is none."""
        for level in range(LEVELS):
            program = self._device.program("blur_levels.comp", defines={} if level else {"FINEST": 1})
            below = (self.light, self.depth) if level else (light, depth)
            program.set(level=level)
            grid = self._finest[0] >> level, self._finest[1] >> level
            run_over_grid(self._device, program, grid, GROUP, {"below_light": below[0], "below_depth": below[1]},
                          (self.light, self.depth))
