"""A pyramid over what is behind rough glass: light, and how near the nearest opaque surface is."""

import moderngl

from app.gl.compute import run_over_grid
from app.gl.context import Device

GROUP = 8  # side of a work group of blur_levels.comp, in texels
UNITS = {"blur_light": 34, "blur_depth": 35}  # texture units beyond those that one stage can have samplers for


class BlurLevels:
    """Coarser levels of a picture, side by side in one texture, see blur_level.glsl; layers use it one after another.

    The driver's mipmaps leave rows out, or count them twice, where a side is odd; these lose no light.
    """

    def __init__(self) -> None:
        self._size = 0, 0
        self._images: tuple[moderngl.Texture, ...] = ()

    @property
    def count(self) -> int:
        """Number of levels; a texel of the coarsest is at least half as wide as the picture."""
        return max(max(self._size) - 1, 2).bit_length() - 1

    def build(self, device: Device, light: moderngl.Texture, depth: moderngl.Texture, glass: moderngl.Texture) -> None:
        """From linear radiance, and from depths of opaque surfaces and of the glass, 0 where there is none."""
        if self._size != light.size:
            self._size = light.size
            both = self._finest[0] * 3 // 2, self._finest[1]
            self._images = device.ctx.texture(both, 4, dtype="f2"), device.ctx.texture(both, 1, dtype="f4")
        for level in range(self.count):
            program = device.program("blur_levels.comp", defines={} if level else {"FINEST": 1})
            names = ("below_light", "below_depth") if level else ("below_light", "below_depth", "glass_depth")
            below = dict(zip(names, self._images if level else (light, depth, glass), strict=True))
            program.set(level=level)
            grid = self._finest[0] >> level, self._finest[1] >> level
            run_over_grid(device, program, grid, GROUP, below, self._images)

    def bind(self) -> None:
        """To the units ``UNITS``: radiance times the share of a texel that counts, with that share, and depth."""
        for texture, unit in zip(self._images, UNITS.values(), strict=True):
            texture.use(unit)

    @property
    def _finest(self) -> tuple[int, int]:
        """Size of level 0, each side a multiple of the coarsest level's texels."""
        coarsest = 2**self.count
        width, height = (-(-side // coarsest) * coarsest // 2 for side in self._size)
        return width, height
