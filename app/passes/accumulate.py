"""Temporal accumulation of the demodulated indirect light, at the network's resolution."""

from __future__ import annotations

from app.gl.frame_state import MotionKind
from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex

# Frames: light follows moving objects, so its history must be short; a moving camera changes no light.
HISTORY = {MotionKind.NONE: 256.0, MotionKind.CAMERA: 10.0, MotionKind.OBJECTS: 3.0}


def declare(grid: tuple[int, int]) -> Pass:
    """Over a low-resolution ``grid`` of width and height; the history is 32-bit like that of TAA."""
    return Pass("accumulate",
                reads=("indirect_now", "normal", "depth", "motion", "indirect_low@prev", "normal@prev", "depth@prev"),
                writes={"indirect_low": Tex("f4", 4, size=grid)},
                make=lambda device, bound: make_fullscreen(device, bound, "accumulate.frag", lambda frame: {
                    "ratio": (frame.size[0] / grid[0], frame.size[1] / grid[1]),
                    "longest": HISTORY[frame.motion], "history_valid": frame.history_valid}))
