"""Outer surfaces, which mirror what is around beside those of the G-buffer.

They are clear coats, and the nearest layer of what is seen through.
"""

from app.gl.fullscreen import make_fullscreen
from app.gl.peeling import PeeledLayer
from app.graph import Pass, Resource, Tex

PREFIX = "outer_"  # of the names of what is drawn of them


def declare(has_clearcoat: bool, nearest: PeeledLayer | None, has_history: bool) -> Pass:
    """The targets of a G-buffer, for the pixels that have such a surface.

    Parameters
    ----------
    nearest : PeeledLayer or None
        Of what is seen through.
    has_history : bool
        Whether what is drawn of them follows their motion.
    """
    color = Tex("f2", 4)
    targets: dict[str, Resource] = {"albedo": color, "normal": color, "depth": Tex("f4", 1),
                                    "specular_roughness": color, **({"motion": color} if has_history else {})}
    coat = ("clearcoat",) if has_clearcoat else ()
    layer = {} if nearest is None else {
        nearest.prefix + name: f"layer_{name}" for name in (*targets, "passage", *coat)}
    opaque = (*coat, *(name for name in targets if name != "specular_roughness")) if has_clearcoat else ()
    return Pass("outer_surface", reads=(*opaque, *layer),
                writes={PREFIX + name: texture for name, texture in targets.items()},
                make=make_fullscreen("outer_surface.frag", samplers=layer))
