"""The common shape of full-screen passes: bind what is read, draw one triangle into what is written."""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext

import moderngl

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.peeling import PeeledLayer
from app.gl.pool import Resources
from app.gl.shader import Program
from app.graph import PREVIOUS, BoundPass

ALWAYS = "1"           # moderngl's depth function that passes always
MIN_SHARED_RATIO = 2.9  # of full to low resolution; images are not always a multiple of their grid
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


def always(frame: FrameState) -> bool:
    """``fast_path`` of passes that draw every frame in two steps."""
    return True


def quads_share_taps(grid: tuple[int, int], frame: FrameState) -> bool:
    """Whether most quads of the image lie between four texels of a low-resolution ``grid`` (quad_taps.glsl)."""
    return all(ratio == 1.0 or ratio >= MIN_SHARED_RATIO for ratio in ratio_to(grid, frame))


def read_defines(bound: BoundPass, strip: str = "") -> dict[str, object]:
    """``HAS_X`` for every resource that the pass really reads; the prefix ``strip`` is left off its name."""
    return {"HAS_" + r.replace(PREVIOUS, "_prev").removeprefix(strip).upper(): 1 for r in bound.reads}


def write_defines(writes: Sequence[str], strip: str = "") -> dict[str, object]:
    """``WRITE_X`` with the index of X's colour attachment; the prefix ``strip`` is left off its name."""
    return {"WRITE_" + w.removeprefix(strip).upper(): i for i, w in enumerate(writes)}


def cube_defines(face: int, camera_axes: bool) -> dict[str, object]:
    """For shaders on the cube around the camera, with ``face`` texels a side."""
    return {"GRID_CUBE": 1, "CUBE_SIZE": face, **({"CUBE_CAMERA_AXES": 1} if camera_axes else {})}


def make_fullscreen(fragment: str, uniforms: Callable[[FrameState], Mapping[str, object]] = lambda frame: {},
                    defines: Mapping[str, object] | None = None, strip: str = "",
                    samplers: Mapping[str, str] | None = None, layer: PeeledLayer | None = None,
                    fast_path: Callable[[FrameState], bool] | None = None) -> Callable[[Device, BoundPass], Execute]:
    """``Pass.make`` of a pass that draws shader ``fragment``.

    Parameters
    ----------
    uniforms : callable
        Gives the uniforms of a frame that are neither textures nor blocks.
    strip, samplers
        See ``Resources.bind``.
    layer : PeeledLayer, optional
        Draw only where it is.
    fast_path : callable, optional
        Whether a frame is drawn in two steps, the first by the shader's variant ``FAST_PATH``. It writes a depth of 1
        where its result stands, else 0; there the shader itself draws. A depth test spares even a software rasteriser
        the rest, which a branch would not.
    """
    def make(device: Device, bound: BoundPass) -> Execute:
        variant = {**read_defines(bound, strip), **write_defines(bound.writes, strip), **(defines or {})}
        program = device.fullscreen(fragment, variant)
        fast_program = device.fullscreen(fragment, {**variant, "FAST_PATH": 1}) if fast_path is not None else None

        def execute(frame: FrameState, resources: Resources) -> None:
            target = resources.target(with_depth=fast_program is not None)
            values = uniforms(frame)

            def draw(program: Program) -> None:
                resources.bind(program, strip, samplers=samplers)
                program.set(**values)
                with nullcontext() if layer is None else layer.within(target, frame):
                    device.draw_fullscreen(program)

            if fast_program is not None and fast_path is not None and fast_path(frame):
                device.ctx.enable_only(moderngl.DEPTH_TEST)
                device.ctx.depth_func, target.depth_mask = ALWAYS, True
                draw(fast_program)
                device.ctx.depth_func, target.depth_mask = ">", False
            else:
                device.ctx.enable_only(moderngl.NOTHING)
            draw(program)

        return execute

    return make
