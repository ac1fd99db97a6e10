"""Indirect light of one bounce from what the screen shows: the classical method, in place of a network."""

from __future__ import annotations

from app.gl.frame_state import FrameState
from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex
from app.math3d import R2

SCALE = 0.5  # of the grid, relative to the output

Size = tuple[int, int]


def grid(size: Size) -> Size:
    """Width and height of the low-resolution grid for an output of the given width and height."""
    return Tex("f2", 4, scale=SCALE).resolve(size)


def declare_picks(low: Size) -> Pass:
    """Copies the radiance of the texels that stand for those of grid ``low``."""
    return Pass("ssgi_radiance", reads=("direct",), optional=("emission",),
                writes={"ssgi_radiance": Tex("f2", 4, size=low)},
                make=lambda device, bound: make_fullscreen(device, bound, "ssgi_radiance.frag", lambda frame: {
                    "ratio": _ratio(frame, low)}))


def declare(low: Size, accumulated: bool) -> Pass:
    """Walks over the image in one direction from each texel.

    Parameters
    ----------
    accumulated : bool
        Whether frames are gathered. Then each walks in other directions; otherwise they are fixed per texel, so that
        still pictures stay still.
    """
    return Pass("ssgi", reads=("lowres_gbuffer", "ssgi_radiance"), writes={"ssgi_walks": Tex("f2", 4, size=low)},
                make=lambda device, bound: make_fullscreen(device, bound, "ssgi.frag", lambda frame: {
                    "ratio": _ratio(frame, low), "noise_phase": frame.noise_phase,
                    "turn": tuple(turn * frame.index % 1.0 if accumulated else 0.0 for turn in R2)}))


def declare_filters(low: Size, output: str) -> tuple[Pass, Pass]:
    """Gather the walks of 9x9 texels on the same surface into ``output``, in two steps."""
    return (_filter("ssgi_filter_near", "ssgi_walks", "ssgi_gathered", low, 1),
            _filter("ssgi_filter_far", "ssgi_gathered", output, low, 3))


def _filter(name: str, source: str, target: str, low: Size, apart: int) -> Pass:
    return Pass(name, reads=(source, "lowres_gbuffer"), writes={target: Tex("f2", 4, size=low)},
                make=lambda device, bound: make_fullscreen(device, bound, "ssgi_filter.frag", lambda frame: {
                    "ratio": _ratio(frame, low), "apart": apart}, {"WALKS": source}))


def _ratio(frame: FrameState, low: Size) -> tuple[float, float]:
    return frame.size[0] / low[0], frame.size[1] / low[1]
