"""Motion and depth of what most light of a pixel comes from, which temporal anti-aliasing follows."""

from app.gl.fullscreen import make_fullscreen
from app.gl.peeling import PeeledLayer
from app.graph import Pass, Tex


def declare(nearest: PeeledLayer) -> Pass:
    """Choose between the nearest layer and the G-buffer."""
    prefix = nearest.prefix
    opaque, layer = ("motion", "depth"), tuple(prefix + name for name in ("motion", "depth", "passage"))
    samplers = {name: "opaque_" + name for name in opaque}
    return Pass("front_motion", reads=(*opaque, *layer),
                writes={"front_motion": Tex("f2", 4), "front_depth": Tex("f4", 1)},
                make=make_fullscreen("front_motion.frag", strip=prefix, samplers=samplers))
