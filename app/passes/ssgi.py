"""One bounce of indirect light from what the screen shows: the classical method, in place of a network."""

from collections.abc import Iterator

from app.gl.fullscreen import make_fullscreen, ratio_to
from app.graph import Pass, Tex
from app.math3d import R2
from app.passes import surface_filter

SCALE = 0.5  # of the grid, relative to the output

Size = tuple[int, int]


def grid(size: Size) -> Size:
    """Width and height of the low-resolution grid for an output of the given width and height."""
    return Tex("f2", 4, scale=SCALE).resolve(size)


def declare(grid: Size, accumulated: bool, target: str) -> Iterator[Pass]:
    """Radiance on the ``grid``, walks over the image, and two filter passes that gather 9x9 walks into ``target``.

    Parameters
    ----------
    accumulated : bool
        Whether frames are accumulated. Then each walks in other directions; otherwise the directions are fixed per
        texel, so that static pictures stay static.
    """
    yield Pass("ssgi_radiance", reads=("direct",), optional=("emission",),
               writes={"ssgi_radiance": Tex("f2", 4, size=grid)},
               make=make_fullscreen("ssgi_radiance.frag", lambda frame: {"ratio": ratio_to(grid, frame)}))
    yield Pass("ssgi", reads=("lowres_gbuffer", "ssgi_radiance"), writes={"ssgi_walks": Tex("f2", 4, size=grid)},
               make=make_fullscreen("ssgi.frag", lambda frame: {
                   "ratio": ratio_to(grid, frame), "noise_phase": frame.noise_phase,
                   "noise_offset": tuple(step * frame.index % 1.0 if accumulated else 0.0 for step in R2)}))
    yield surface_filter.declare("ssgi_filter_near", "ssgi_walks", "ssgi_gathered", grid, 1, divided=False)
    yield surface_filter.declare("ssgi_filter_far", "ssgi_gathered", target, grid, 3, divided=True)
