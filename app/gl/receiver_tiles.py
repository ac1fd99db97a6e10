"""What tiles of a grid of receivers learn from shadow rays, to guide later ones."""

import numpy as np

from app.arrays import Floats, Ints

TILE = 18            # receivers along the edge of a tile, two blocks of shadow_rays.frag
FIRST_SAMPLES = 4    # of each receiver, by which a frame without history learns
OPEN = 0.5           # visible share of the light from which on rays are spread as if nothing was in the way
DECAY = 0.9          # of what was learned, per frame, while the camera or something moves,
MOVING_SAMPLES = 8.0  # and of each receiver at most


def tiles(size: tuple[int, int]) -> tuple[int, int]:
    """Columns and rows of the tiles of a grid of receivers of that width and height."""
    return -(-size[0] // TILE), -(-size[1] // TILE)


class ReceiverTiles:
    """Receivers in tiles, and when to use what was learned.

    Attributes
    ----------
    shape : tuple of int
        Rows and columns of the tiles.
    count : int
        Of tiles.
    tile : ndarray of int, shape (h · w,)
        Of each receiver.

    Parameters
    ----------
    size : tuple of int
        Width and height of the grid of receivers.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        columns, rows = tiles(size)
        y, x = np.divmod(np.arange(size[0] * size[1]), size[0])
        self.shape, self.count = (rows, columns), rows * columns
        self.tile: Ints = y // TILE * columns + x // TILE
        self.restart()

    def restart(self) -> None:
        """Count samples from none again."""
        self._samples, self._new_samples = 0.0, 0  # of each receiver, learned from in all and since the last update

    def fade(self) -> float:
        """Trust the samples until now less, because something moves: by the factor that this returns."""
        factor = min(DECAY, MOVING_SAMPLES / max(self._samples, 1.0))
        self._samples *= factor
        return factor

    def is_due(self) -> bool:
        """Count one more sample of each receiver; whether there are as many new ones as old ones."""
        self._new_samples += 1
        if self._new_samples < max(self._samples, FIRST_SAMPLES):
            return False
        self._samples += self._new_samples
        self._new_samples = 0
        return True

    def with_neighbours(self, values: Floats) -> Floats:
        """Of tiles, (tiles, …), half by their own and half by those around, as few of their rays may have arrived."""
        grid = values.reshape(*self.shape, *values.shape[1:])
        padded = np.pad(grid, [(1, 1), (1, 1)] + [(0, 0)] * (grid.ndim - 2))
        rows = padded[:-2] + padded[1:-1] + padded[2:]
        around = rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]
        return np.asarray((grid * 7 + around) / 16).reshape(values.shape)
