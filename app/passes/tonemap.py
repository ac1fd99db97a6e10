"""The display image of the finished picture."""

from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare(source: str) -> Pass:
    """From ``taa``, or from ``lit`` without temporal anti-aliasing."""
    return Pass("tonemap", reads=(source,), writes={"display": Tex("f1", 4)},
                make=make_fullscreen("tonemap.frag", lambda frame: {"exposure": frame.exposure}))
