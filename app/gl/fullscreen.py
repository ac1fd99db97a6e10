"""The common shape of full-screen passes: bind what is read, draw one triangle into what is written."""

from collections.abc import Callable, Mapping

import moderngl

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.pool import Resources
from app.graph import PREVIOUS, BoundPass

CUBE_PREFIX = "cube_"  # of the names of what is drawn on the cube around the camera


def ratio_to(grid: tuple[int, int], frame: FrameState) -> tuple[float, float]:
    """Full-resolution texels per texel of a low-resolution ``grid`` of width and height."""
    return frame.size[0] / grid[0], frame.size[1] / grid[1]


def read_defines(bound: BoundPass) -> dict[str, object]:
    """``HAS_X`` for every resource that the pass really reads."""
    return {"HAS_" + r.replace(PREVIOUS, "_prev").upper(): 1 for r in bound.reads}


def write_defines(bound: BoundPass, strip: str = "") -> dict[str, object]:
    """``WRITE_X`` with the index of X's colour attachment; the prefix ``strip`` is left off its name."""
    return {"WRITE_" + w.removeprefix(strip).upper(): i for i, w in enumerate(bound.writes)}


def cube_defines(face: int, camera_axes: bool) -> dict[str, object]:
    """For shaders on the cube around the camera, with ``face`` texels a side."""
    return {"GRID_CUBE": 1, "CUBE_SIZE": face, **({"CUBE_CAMERA_AXES": 1} if camera_axes else {})}


def make_fullscreen(fragment: str, uniforms: Callable[[FrameState], Mapping[str, object]] = lambda frame: {},
                    defines: Mapping[str, object] | None = None, strip: str = "",
                    samplers: Mapping[str, str] | None = None) -> Callable[[Device, BoundPass], Execute]:
    """``Pass.make`` of a pass that draws shader ``fragment``.

    Parameters
    ----------
    uniforms : callable
        Gives the uniforms of a frame that are neither textures nor blocks.
    strip, samplers
        See ``Resources.bind``.
    """
    def make(device: Device, bound: BoundPass) -> Execute:
        program = device.fullscreen(fragment, {**read_defines(bound), **write_defines(bound, strip), **(defines or {})})

        def execute(frame: FrameState, resources: Resources) -> None:
            resources.target()
            device.ctx.enable_only(moderngl.NOTHING)
            resources.bind(program, strip, samplers=samplers)
            program.set(**uniforms(frame))
            device.draw_fullscreen(program)

        return execute

    return make
