"""Outer surfaces, which mirror what is around before the light of the G-buffer's: clear coats, and the nearest layer of
what is seen through.
"""

from app.gl.fullscreen import make_fullscreen
from app.gl.peeling import PeeledLayer
from app.graph import Pass, Resource, Tex

PREFIX = "outer_"  # of the names of what is drawn of them


def declare(has_clearcoat: bool, nearest: PeeledLayer | None) -> Pass:
    """The targets of a G-buffer, for the pixels that have such a surface.

    Parameters
    ----------
    nearest : PeeledLayer or None
        Of what is seen through.
    """
    color = Tex("f2", 4)
    targets: dict[str, Resource] = {"albedo": color, "normal": color, "depth": Tex("f4", 1),
                                    "specular_roughness": color, "motion": color}
    layer = {} if nearest is None else {
        nearest.prefix + name: f"layer_{name}" for name in (*targets, "passage")}
    opaque = ("albedo", "normal", "depth", "motion", "clearcoat") if has_clearcoat else ()
    return Pass("outer_surface", reads=(*opaque, *layer),
                writes={PREFIX + name: texture for name, texture in targets.items()},
                make=make_fullscreen("outer_surface.frag", samplers=layer))
