"""Temporal anti-aliasing."""

from __future__ import annotations

from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare() -> Pass:
    """The history is 32-bit: hundreds of still frames accumulate in it."""
    return Pass("taa", reads=("lit", "motion", "taa@prev", "depth@prev"), writes={"taa": Tex("f4", 4)},
                make=lambda device, bound: make_fullscreen(device, bound, "taa.frag", lambda frame: {
                    "history_valid": frame.history_valid, "near": frame.view.near}))
