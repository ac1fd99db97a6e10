"""Sharpening of what temporal anti-aliasing has blurred by resampling its history."""

from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare(size: tuple[int, int]) -> Pass:
    """Of the shown picture only, of a width and height; texels never resampled stay those of ``taa`` to the bit."""
    return Pass("sharpen", reads=("taa", "resampled"), writes={"sharpened": Tex("f4", 4, size=size)},
                make=make_fullscreen("sharpen.frag"))
