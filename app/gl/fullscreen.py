"""The common shape of full-screen passes: bind what is read, draw one triangle into what is written."""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext

import moderngl

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.peeling import PeeledLayer
from app.gl.pool import Resources
from app.graph import PREVIOUS, BoundPass

CUBE_PREFIX = "cube_"  # of the names of what is drawn on the cube around the camera


def reduced_grid(size: tuple[int, int], max_texels: int) -> tuple[int, int]:
    """Width and height of an image's low-resolution grid: its own, divided by a whole number as small as possible."""
    divisor = 1
    while math.prod(smaller := (-(-size[0] // divisor), -(-size[1] // divisor))) > max_texels:
        divisor += 1
    return smaller


def ratio_to(grid: tuple[int, int], frame: FrameState) -> tuple[float, float]:
    """Full-resolution texels per texel of a low-resolution ``grid`` of width and height."""
    return frame.size[0] / grid[0], frame.size[1] / grid[1]


def read_defines(bound: BoundPass) -> dict[str, object]:
    """``HAS_X`` for every resource that the pass really reads."""
    return {"HAS_" + r.replace(PREVIOUS, "_prev").upper(): 1 for r in bound.reads}


def write_defines(writes: Sequence[str], strip: str = "") -> dict[str, object]:
    """``WRITE_X`` with the index of X's colour attachment; the prefix ``strip`` is left off its name."""
    return {"WRITE_" + w.removeprefix(strip).upper(): i for i, w in enumerate(writes)}


def cube_defines(face: int, camera_axes: bool) -> dict[str, object]:
    """For shaders on the cube around the camera, with ``face`` texels a side."""
    return {"GRID_CUBE": 1, "CUBE_SIZE": face, **({"CUBE_CAMERA_AXES": 1} if camera_axes else {})}


def make_fullscreen(fragment: str, uniforms: Callable[[FrameState], Mapping[str, object]] = lambda frame: {},
                    defines: Mapping[str, object] | None = None, strip: str = "",
                    samplers: Mapping[str, str] | None = None,
                    layer: PeeledLayer | None = None) -> Callable[[Device, BoundPass], Execute]:
    """``Pass.make`` of a pass that draws shader ``fragment``.

    Parameters
    ----------
    uniforms : callable
        Gives the uniforms of a frame that are neither textures nor blocks.
    strip, samplers
        See ``Resources.bind``.
    layer : PeeledLayer, optional
        Draw only where it is.
    """
    def make(device: Device, bound: BoundPass) -> Execute:
        program = device.fullscreen(fragment, {**read_defines(bound), **write_defines(bound.writes, strip),
                                               **(defines or {})})

        def execute(frame: FrameState, resources: Resources) -> None:
            target = resources.target()
            device.ctx.enable_only(moderngl.NOTHING)
            resources.bind(program, strip, samplers=samplers)
            program.set(**uniforms(frame))
            with nullcontext() if layer is None else layer.within(target, frame):
                device.draw_fullscreen(program)

        return execute

    return make
