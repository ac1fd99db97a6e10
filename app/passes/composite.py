"""Direct light + albedo × indirect light + emission + highlights, and the background."""

from __future__ import annotations

from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare(has_indirect: bool) -> Pass:
    """The albedo is read only where there is indirect light to modulate."""
    return Pass("composite", reads=("direct", *(("indirect", "albedo") if has_indirect else ())),
                optional=("emission", "specular", "background"), writes={"lit": Tex("f2", 4)},
                make=lambda device, bound: make_fullscreen(device, bound, "composite.frag"))
