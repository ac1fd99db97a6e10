"""Where shadow rays find the environment: in a room, through its windows.

Rays that are spread over the light of a whole sky mostly end at walls there. So each tile of receivers counts in which
parts of the environment its rays have arrived, and sends later ones to these parts, as Vévoda, Kondapaneni and Křivánek
2018, "Bayesian Online Regression for Adaptive Direct Illumination Sampling", learn which lights a region sees. Some
rays go everywhere, so nothing is missed.
"""

import numpy as np

from app.arrays import F32, Bools, Ints
from app.gl.context import Device
from app.gl.receiver_tiles import OPEN, ReceiverTiles
from app.gl.shader import Program
from app.sky_parts import PARTS, blur_parts

ENTRIES = 1024       # of the list of parts that the rays of a tile choose from
MIN_SHARE = 0.02     # of the sky's light that a tile is taken to see, in the choice between lights
TEXTURE_UNIT = 13    # of the guide, beyond those of what passes read
DEFINES = {"GUIDE_PARTS": PARTS, "GUIDE_ENTRIES": ENTRIES}


class SkyGuide:
    """Which parts of the environment the receivers of each tile of a grid see.

    Parameters
    ----------
    size : tuple of int
        Width and height of the grid of receivers.
    """

    def __init__(self, device: Device, size: tuple[int, int]) -> None:
        self._tiles = ReceiverTiles(size)
        self._texture = device.ctx.texture((PARTS**2 + ENTRIES + 1, self._tiles.count), 1, dtype="u4")
        self.forget()

    def forget(self) -> None:
        """Spread rays over all light again."""
        self._tiles.restart()
        count = self._tiles.count
        self._visible = np.zeros((count, PARTS**2))  # luminance that has arrived from each part
        self._unshadowed = np.zeros(count)           # and that would have if nothing was in the way
        self._shown, self._shown_samples = np.zeros((2, count)), 0.0  # of each tile as above, for visible_share
        self._update()

    @property
    def visible_share(self) -> F32:
        """Visible share of the environment's light in each tile and around, shape (h, w); 0 where there is none."""
        visible, unshadowed = (self._tiles.with_neighbours(sums) for sums in self._shown)
        share = np.minimum(visible / np.maximum(unshadowed, 1e-30), 1)
        return share.reshape(self._tiles.shape).astype(np.float32)

    def keep(self, samples: float) -> None:
        """Let ``visible_share`` count at most so many samples of each receiver that were learned by until now."""
        self._shown *= min(samples / max(self._shown_samples, 1e-30), 1.0)
        self._shown_samples = min(self._shown_samples, samples)

    @property
    def guides(self) -> Bools:
        """Which receivers have their rays guided, shape (h · w,)."""
        return self._guides[self._tiles.tile]

    def bind(self, program: Program) -> None:
        """Let ``program`` read the guide."""
        self._texture.use(TEXTURE_UNIT)
        program.set(sky_guide=TEXTURE_UNIT, guide_columns=self._tiles.shape[1])

    def fade(self) -> None:
        """Trust what was learned in earlier frames less."""
        factor = self._tiles.fade()
        for sums in (self._visible, self._unshadowed):
            sums *= factor

    def learn(self, receivers: Ints, parts: Ints, luminance: F32, sky: F32) -> None:
        """Take which rays have arrived of one more of each receiver; those that follow are guided by it.

        Parameters
        ----------
        receivers : ndarray of int, shape (N,)
            Where the rays began.
        parts : ndarray of int, shape (N,)
            Which part of the environment each has arrived in.
        luminance : ndarray, float32, shape (N,)
            Of its irradiance over its probability.
        sky : ndarray, float32, shape (h · w,)
            Luminance of the unshadowed irradiance of each receiver that had a ray.
        """
        at = self._tiles.tile.take(receivers) * PARTS**2 + parts
        found = np.bincount(at, luminance, self._visible.size).reshape(self._visible.shape)
        sent = np.bincount(self._tiles.tile, sky, len(self._unshadowed))
        self._visible += found
        self._unshadowed += sent
        self._shown += found.sum(axis=1), sent
        self._shown_samples += 1
        if self._tiles.is_due():
            self._update()

    def _update(self) -> None:
        around = self._tiles.with_neighbours(self._visible)
        visible = blur_parts(np.asarray(around, np.float32))
        total = visible.sum(axis=1)
        share = total / np.maximum(self._tiles.with_neighbours(self._unshadowed), 1e-30)
        self._guides = (total > 0) & (share < OPEN)
        table = np.zeros((len(total), PARTS**2 + ENTRIES + 1), np.uint32)
        chosen = np.flatnonzero(self._guides)
        table[chosen, :-1] = _entries(visible[chosen] / total[chosen, None])
        table[:, -1] = np.where(self._guides, np.clip(share, MIN_SHARE, 1), 1).astype(np.float32).view(np.uint32)
        self._texture.write(table)


def _entries(chance: F32) -> Ints:
    """How often each part is among ENTRIES of equal chances, and these entries, shape (tiles, parts + ENTRIES).

    An entry holds its part in 10 bits, which of the entries of this part it is in 11, and how many these are in 11.
    """
    tiles = len(chance)
    bounds = np.rint(np.cumsum(chance, axis=1) * ENTRIES).astype(np.int32)
    bounds[:, -1] = ENTRIES
    count = np.diff(bounds, axis=1, prepend=np.int32(0))
    listed = np.flatnonzero(count)
    count_of = count.ravel()[listed]
    part = listed % PARTS**2
    first = bounds.ravel()[listed] - count_of
    entry = np.repeat((part | count_of.astype(np.int64) << 21) - (first << 10), count_of).reshape(tiles, ENTRIES)
    return np.concatenate([count, entry + (np.arange(ENTRIES) << 10)], axis=1)
