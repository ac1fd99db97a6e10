"""Fills the sky of low-resolution light from the surfaces around it, for surfaces too thin for its texels."""

from collections.abc import Mapping

import moderngl

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex


def declare(name: str, grid: tuple[int, int], light: str, surface: str, target: str) -> Pass:
    """Over a low-resolution ``grid`` of width and height: ``light`` on the G-buffer ``surface`` becomes ``target``."""
    samplers = {light: "light_low", surface: "lowres_gbuffer"}
    return Pass(name, reads=(light, surface), writes={target: Tex("f4", 4, size=grid)},
                make=lambda device, bound: make(device, bound, grid, samplers))


def make(device: Device, bound: BoundPass, grid: tuple[int, int], samplers: Mapping[str, str]) -> Execute:
    mask, fill = device.fullscreen("push_pull_mask.frag"), device.fullscreen("push_pull.frag")
    size = _power_of_two(grid[0]), _power_of_two(grid[1])  # mipmaps of other sizes leave texels out
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
    """The smallest power of two that is at least ``n``."""
    return 1 << (n - 1).bit_length()
