"""Surface points relative to the eye, for those who ask for the position AOV."""

from __future__ import annotations

from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare() -> Pass:
    return Pass("position", reads=("depth",), writes={"position": Tex("f4", 4)},
                make=lambda device, bound: make_fullscreen(device, bound, "position.frag"))
