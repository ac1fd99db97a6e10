"""Which of the lights with traced shadows the receivers see.

Shadow rays go to lights as often as these would contribute if nothing was in the way: beside a bright strip that a
mirror hides, few find the lamp that does shine there. So each tile of receivers counts which share of each light its
rays have found, and later rays go to hidden lights less often, as Vévoda, Kondapaneni and Křivánek 2018, "Bayesian
Online Regression for Adaptive Direct Illumination Sampling", learn which lights a region sees.
"""

import numpy as np

from app.arrays import F32, Bools, Ints
from app.gl.context import Device
from app.gl.receiver_tiles import OPEN, ReceiverTiles
from app.gl.shader import Program

MIN_SHARE = 0.05  # of a light that a tile is taken to see, in the choice between lights
MAX_DIFFERENCE = 0.1  # of what rays bring from the analytic irradiance; where they bring another light, none are guided
TEXTURE_UNIT = 14  # of the guide, beyond those of what passes read


class LightGuide:
    """The share of each light that the tiles of a grid of receivers see.

    Parameters
    ----------
    size : tuple of int
        Width and height of the grid of receivers.
    count : int
        Of lights in the block, also those whose shadows are not traced.
    """

    def __init__(self, device: Device, size: tuple[int, int], count: int) -> None:
        self._count, self._tiles = count, ReceiverTiles(size)
        self._texture = device.ctx.texture((count + 1, self._tiles.count), 1, dtype="f4")
        self.forget()

    def forget(self) -> None:
        """Spread rays over all light again."""
        self._tiles.restart()
        self._analytic, self._unshadowed, self._visible, self._rays = np.zeros((4, self._tiles.count, self._count))
        self._update()

    @property
    def guides(self) -> Bools:
        """Which receivers have their rays guided, shape (h · w,)."""
        return self._guides[self._tiles.tile]

    def bind(self, program: Program) -> None:
        """Let ``program`` read the guide."""
        self._texture.use(TEXTURE_UNIT)
        program.set(light_guide=TEXTURE_UNIT, guide_columns=self._tiles.shape[1])

    def fade(self) -> None:
        """Trust what was learned in earlier frames less."""
        factor = self._tiles.fade()
        for sums in (self._analytic, self._unshadowed, self._visible, self._rays):
            sums *= factor

    def learn(self, receivers: Ints, lights: Ints, analytic: F32, unshadowed: F32, visible: F32) -> None:
        """Take what rays of one more sample of each receiver have found; those that follow are guided by it.

        Parameters
        ----------
        receivers, lights : ndarray of int, shape (N,)
            Where the rays began and to which light they went.
        analytic, unshadowed, visible : ndarray, float32, shape (N,)
            Luminance, over the ray's probability, of the light's irradiance, and of what the ray brings without and
            with occlusion.
        """
        at = self._tiles.tile.take(receivers) * self._count + lights
        for sums, values in ((self._analytic, analytic), (self._unshadowed, unshadowed), (self._visible, visible),
                             (self._rays, None)):
            sums += np.bincount(at, values, sums.size).reshape(sums.shape)
        if self._tiles.is_due():
            self._update()

    def _update(self) -> None:
        analytic, unshadowed, visible, rays = (self._tiles.with_neighbours(sums) for sums in (
            self._analytic, self._unshadowed, self._visible, self._rays))
        # As if one more ray had found it: what few rays have not may be seen.
        share = (visible / np.maximum(unshadowed, 1e-30) * rays + 1) / (rays + 1)
        brought = unshadowed.sum(axis=1) / np.maximum(analytic.sum(axis=1), 1e-30)
        self._guides = (visible.sum(axis=1) < OPEN * unshadowed.sum(axis=1)) & (np.abs(brought - 1) < MAX_DIFFERENCE)
        table = np.where(self._guides[:, None], np.clip(share, MIN_SHARE, 1), 1)
        table = np.concatenate([table, (self._guides * brought)[:, None]], axis=1)
        self._texture.write(table.astype(np.float32).tobytes())
