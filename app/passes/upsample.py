"""Joint bilateral upsampling of the network's output to full resolution."""

from __future__ import annotations

from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex
from app.passes.accumulate import HISTORY

BEFORE = ("motion", "indirect@prev", "normal@prev", "depth@prev")


def declare(grid: tuple[int, int], gathered: bool) -> Pass:
    """From a low-resolution ``grid`` of width and height.

    Parameters
    ----------
    gathered : bool
        Whether pixels that no low-resolution texel shows keep the light that they had.
    """
    return Pass("upsample", reads=("indirect_filled", "normal", "depth", *(BEFORE if gathered else ())),
                writes={"indirect": Tex("f2", 4)},
                make=lambda device, bound: make_fullscreen(device, bound, "upsample.frag", lambda frame: {
                    "ratio": (frame.size[0] / grid[0], frame.size[1] / grid[1]),
                    **({"longest": HISTORY[frame.motion], "history_valid": frame.history_valid} if gathered else {})}))
