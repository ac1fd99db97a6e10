"""Joint bilateral upsampling of the network's output to full resolution."""

from __future__ import annotations

from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare(grid: tuple[int, int]) -> Pass:
    """From a low-resolution ``grid`` of width and height."""
    return Pass("upsample", reads=("indirect_filled", "normal", "depth"), writes={"indirect": Tex("f2", 4)},
                make=lambda device, bound: make_fullscreen(device, bound, "upsample.frag", lambda frame: {
                    "ratio": (frame.size[0] / grid[0], frame.size[1] / grid[1])}))
