"""Averages of noisy values over texels of a low-resolution grid that show the same surface."""

from app.gl.fullscreen import make_fullscreen, ratio_to
from app.graph import Pass, Tex


def declare(name: str, source: str, target: str, grid: tuple[int, int], spacing: int, divided: bool) -> Pass:
    """Average 3×3 texels of a ``grid`` of width and height that are ``spacing`` apart.

    Parameters
    ----------
    source : str
        Values times their weights, and the weights.
    divided : bool
        Whether ``target`` gets mean values, else what ``source`` has.
    """
    defines = {"WEIGHTED": source, **({"DIVIDED": 1} if divided else {})}
    return Pass(name, reads=(source, "lowres_gbuffer"), writes={target: Tex("f2", 4, size=grid)},
                make=make_fullscreen("surface_filter.frag", lambda frame: {
                    "ratio": ratio_to(grid, frame), "spacing": spacing}, defines))
