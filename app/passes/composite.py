"""Direct light + albedo × occlusion × indirect light + emission + specular light + reflections, and the background."""

from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare(has_indirect: bool, target: str) -> Pass:
    """Albedo and occlusion are read only where there is indirect light to modulate."""
    return Pass("composite", reads=("direct", *(("indirect", "albedo") if has_indirect else ())),
                optional=("emission", "specular", "reflection", "background",
                          *(("occlusion",) if has_indirect else ())),
                writes={target: Tex("f2", 4)}, make=make_fullscreen("composite.frag"))
