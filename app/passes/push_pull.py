"""Fills the sky of low-resolution light, so that surfaces too thin for its texels find some."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import moderngl

from app.gl.context import Device
from app.gl.frame_state import FrameState
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex


def declare(grid: tuple[int, int], light: str, surface: str, name: str) -> Pass:
    """Over a low-resolution ``grid`` of width and height: ``light_low``, on ``surface``, into ``light_filled``."""
    reads = {f"{light}_low": "light_low", surface: "lowres_gbuffer"}
    return Pass(name, reads=tuple(reads), writes={f"{light}_filled": Tex("f4", 4, size=grid)},
                make=lambda device, bound: make(device, bound, grid, reads))


def make(device: Device, bound: BoundPass, grid: tuple[int, int],
         samplers: Mapping[str, str]) -> Callable[[FrameState, Resources], None]:
    mask, fill = device.fullscreen("push_pull_mask.frag"), device.fullscreen("push_pull.frag")
    size = _power_of_two(grid[0]), _power_of_two(grid[1])  # levels of other sizes leave texels out
    pyramid = device.ctx.texture(size, 4, dtype="f4")
    pyramid.repeat_x = pyramid.repeat_y = False
    finest = device.ctx.framebuffer([pyramid])

    def execute(frame: FrameState, resources: Resources) -> None:
        device.ctx.enable_only(moderngl.NOTHING)
        finest.use()
        resources.bind(mask, samplers=samplers)
        mask.set(span=(grid[0] / size[0], grid[1] / size[1]))
        device.draw_fullscreen(mask)
        pyramid.build_mipmaps()
        resources.target()
        resources.bind(fill, samplers=samplers)
        pyramid.use(len(bound.reads))
        fill.set(pyramid=len(bound.reads))
        device.draw_fullscreen(fill)

    return execute


def _power_of_two(n: int) -> int:
    """The smallest that is at least ``n``."""
    return 1 << (n - 1).bit_length()
