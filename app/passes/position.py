"""Surface points relative to the eye, for the position AOV."""

from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare() -> Pass:
    return Pass("position", reads=("depth",), writes={"position": Tex("f4", 4)}, make=make_fullscreen("position.frag"))
