"""Temporal accumulation of the demodulated indirect light, at low resolution."""

from __future__ import annotations

from collections.abc import Callable

from app.gl.context import Device
from app.gl.frame_state import HISTORY, FrameState
from app.gl.fullscreen import make_fullscreen
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex


def declare(grid: tuple[int, int], noisy: bool = False) -> Pass:
    """Over a low-resolution ``grid`` of width and height; the history is 32-bit like that of TAA.

    Parameters
    ----------
    noisy : bool
        Whether texels differ a lot from frame to frame, so that their history is not judged by one of them alone.
    """
    return Pass("accumulate",
                reads=("indirect_now", "lowres_gbuffer", "motion", "indirect_low@prev", "lowres_gbuffer@prev"),
                writes={"indirect_low": Tex("f4", 4, size=grid)},
                make=lambda device, bound: make(device, bound, grid, noisy))


def make(device: Device, bound: BoundPass, grid: tuple[int, int],
         noisy: bool) -> Callable[[FrameState, Resources], None]:
    draw = make_fullscreen(device, bound, "accumulate.frag", lambda frame: {
        "ratio": (frame.size[0] / grid[0], frame.size[1] / grid[1]),
        "longest": HISTORY[frame.motion], "history_valid": frame.history_valid}, {"NOISY": 1} if noisy else {})

    def execute(frame: FrameState, resources: Resources) -> None:
        if noisy:
            resources["indirect_now"].build_mipmaps()
        draw(frame, resources)

    return execute
