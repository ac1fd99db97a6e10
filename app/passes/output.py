"""The finished picture, linear and for display."""

from __future__ import annotations

from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare(source: str) -> Pass:
    """From ``taa``, or from ``lit`` without temporal anti-aliasing."""
    return Pass("output", reads=(source,), writes={"final": Tex("f4", 4), "display": Tex("f1", 4)},
                make=lambda device, bound: make_fullscreen(device, bound, "output.frag", lambda frame: {
                    "unscale": 1.0 / frame.lights.scale, "exposure": frame.exposure}))
