"""Sharpening of what temporal anti-aliasing has blurred by resampling its history."""

from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare() -> Pass:
    """Of the shown picture only; texels that were never resampled stay those of ``taa`` to the bit."""
    return Pass("sharpen", reads=("taa", "resampled"), writes={"sharpened": Tex("f4", 4)},
                make=make_fullscreen("sharpen.frag"))
