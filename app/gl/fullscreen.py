"""The common shape of full-screen passes: bind what is read, draw one triangle into what is written."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import moderngl

from app.gl.context import Device
from app.gl.frame_state import FrameState
from app.gl.pool import Resources
from app.graph import PREVIOUS, BoundPass

Uniforms = Callable[[FrameState], Mapping[str, Any]]
CUBE_PREFIX = "cube_"  # begins the names of what is drawn on the six views around the camera


def no_uniforms(frame: FrameState) -> Mapping[str, Any]:
    return {}


def read_defines(bound: BoundPass) -> dict[str, object]:
    """``HAS_X`` for every resource that the pass really reads."""
    return {"HAS_" + r.replace(PREVIOUS, "_prev").upper(): 1 for r in bound.reads}


def write_defines(bound: BoundPass, strip: str = "") -> dict[str, object]:
    """``WRITE_X`` with the index of the colour attachment that X is; ``strip`` is left off its name."""
    return {"WRITE_" + w.removeprefix(strip).upper(): i for i, w in enumerate(bound.writes)}


def cube_defines(face: int, camera_axes: bool) -> dict[str, object]:
    """For shaders on the six views around the camera, of ``face`` texels a side."""
    return {"GRID_CUBE": 1, "CUBE_SIZE": face, **({"CUBE_CAMERA_AXES": 1} if camera_axes else {})}


def make_fullscreen(device: Device, bound: BoundPass, fragment: str, uniforms: Uniforms = no_uniforms,
                    defines: Mapping[str, object] | None = None,
                    strip: str = "",
                    samplers: Mapping[str, str] | None = None) -> Callable[[FrameState, Resources], None]:
    """Executor that draws shader ``fragment``; ``uniforms(frame)`` gives what is neither texture nor block.

    ``strip`` and ``samplers``: see ``Resources.bind``.
    """
    program = device.fullscreen(
        fragment, {**read_defines(bound), **write_defines(bound, strip), **(defines or {})})

    def execute(frame: FrameState, resources: Resources) -> None:
        resources.target()
        device.ctx.enable_only(moderngl.NOTHING)
        resources.bind(program, strip, samplers=samplers)
        program.set(**uniforms(frame))
        device.draw_fullscreen(program)

    return execute
