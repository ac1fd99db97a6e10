"""Direct light + albedo × occlusion × indirect light + emission + specular light + reflections, and the background."""

from app.graph import Pass, Tex
from app.passes.reflection import make_with_reflections


def declare(has_indirect: bool, target: str, reflection: tuple[str, ...], grid: tuple[int, int],
            follows_images: bool) -> Pass:
    """Albedo and occlusion are read only where there is indirect light to modulate.

    Parameters
    ----------
    reflection : tuple of str
        What reflections are made of; none without them.
    grid : tuple of int
        Width and height of the grid of reflections.
    follows_images : bool
        As of ``reflection.declare_detail``.
    """
    return Pass("composite", reads=("direct", *(("indirect", "albedo") if has_indirect else ()), *reflection),
                optional=("emission", "specular", "background",
                          *(("outer_reflection",) if "clearcoat" in reflection else ()),
                          *(("occlusion",) if has_indirect else ())),
                writes={target: Tex("f2", 4)},
                make=make_with_reflections("composite.frag", grid, follows_images))
