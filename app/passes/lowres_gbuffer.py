"""Picks the surfaces of the low-resolution grid: one texel stands for those around it, none are averaged."""

from __future__ import annotations

from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare(grid: tuple[int, int], surface: str, name: str) -> Pass:
    """Over a low-resolution ``grid`` of width and height, into ``surface``."""
    return Pass(name, reads=("normal", "depth"), writes={surface: Tex("f4", 4, size=grid)},
                make=lambda device, bound: make_fullscreen(device, bound, "lowres_gbuffer.frag", lambda frame: {
                    "ratio": (frame.size[0] / grid[0], frame.size[1] / grid[1])}))
