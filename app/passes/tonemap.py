"""The display image of the finished picture."""

from __future__ import annotations

from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare(source: str) -> Pass:
    """From ``taa``, or from ``lit`` without temporal anti-aliasing."""
    return Pass("tonemap", reads=(source,), writes={"display": Tex("f1", 4)},
                make=lambda device, bound: make_fullscreen(device, bound, "tonemap.frag", lambda frame: {
                    "exposure": frame.exposure / frame.lights.scale}))
