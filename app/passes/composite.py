"""Direct light + albedo × indirect light + emission + specular light, and the background."""

from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare(has_indirect: bool) -> Pass:
    """The albedo is read only where there is indirect light to modulate."""
    return Pass("composite", reads=("direct", *(("indirect", "albedo") if has_indirect else ())),
                optional=("emission", "specular", "background"), writes={"lit": Tex("f2", 4)},
                make=make_fullscreen("composite.frag"))
