"""Direct light + albedo × occlusion × indirect light + emission + specular light + reflections, and the background."""

from collections.abc import Callable, Mapping

from app.gl.frame_state import FrameState
from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare(has_indirect: bool, target: str, reflection: tuple[str, ...],
            uniforms: Callable[[FrameState], Mapping[str, object]]) -> Pass:
    """Albedo and occlusion are read only where there is indirect light to modulate.

    Parameters
    ----------
    reflection : tuple of str
        What reflections are made of; none without them.
    uniforms : callable
        Those of reflections in a frame.
    """
    return Pass("composite", reads=("direct", *(("indirect", "albedo") if has_indirect else ()), *reflection),
                optional=("emission", "specular", "background", *(("occlusion",) if has_indirect else ())),
                writes={target: Tex("f2", 4)}, make=make_fullscreen("composite.frag", uniforms))
