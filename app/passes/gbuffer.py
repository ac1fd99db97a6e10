"""The G-buffer: attributes of the nearest surface in every texel of the screen, or of the six views around."""

from __future__ import annotations

from collections.abc import Callable

import moderngl
import numpy as np
from numpy.typing import NDArray

from app.gl.context import Device
from app.gl.frame_state import FrameState
from app.gl.fullscreen import CUBE_PREFIX, write_defines
from app.gl.geometry import Drawable
from app.gl.pool import Resources
from app.gl.shader import Program
from app.graph import BoundPass, Pass, Resource, Tex
from app.math3d import cube_rotations, perspective_reversed
from app.scene import Scene

FEATURES = ("ALBEDO_MAP", "EMISSION_MAP", "VERTEX_COLOR", "ALPHA_MASK")
F64 = NDArray[np.float64]


def targets(scene: Scene, size: tuple[int, int] | None = None) -> dict[str, Resource]:
    """What a G-buffer of ``scene`` can hold; nothing that the scene has no use for."""
    found: dict[str, Resource] = {"albedo": Tex("f2", 4, size=size), "normal": Tex("f2", 4, size=size),
                                  "depth": Tex("f4", 1, size=size)}
    if any(m.emits for m in scene.materials):
        found["emission"] = Tex("f2", 4, size=size)
    if any(m.has_specular for m in scene.materials):
        found["specular_roughness"] = Tex("f2", 4, size=size)
    return found


def declare(scene: Scene) -> Pass:
    """The screen's G-buffer."""
    return Pass("gbuffer", writes={**targets(scene), "motion": Tex("f2", 4)}, make=make)


def make(device: Device, bound: BoundPass) -> Callable[[FrameState, Resources], None]:
    def execute(frame: FrameState, resources: Resources) -> None:
        target = resources.target(with_depth=True)
        target.clear(depth=0.0)
        draw_surfaces(device, frame, frame.view.clip_from_relative(frame.jitter), write_defines(bound))

    return execute


def declare_cube(scene: Scene, face: int, camera_axes: bool) -> Pass:
    """The six views' G-buffer: an atlas row of faces with ``face`` texels a side, in contract order."""
    writes = {f"cube_{name}": tex for name, tex in targets(scene, (6 * face, face)).items()}

    def make_cube(device: Device, bound: BoundPass) -> Callable[[FrameState, Resources], None]:
        rotations = cube_rotations()

        def execute(frame: FrameState, resources: Resources) -> None:
            target = resources.target(with_depth=True)
            target.viewport = (0, 0, *target.size)
            target.clear(depth=0.0)
            for index, rotation in enumerate(rotations):
                target.viewport = (index * face, 0, face, face)
                clip = np.eye(4)
                clip[:3, :3] = rotation @ frame.view.rotation if camera_axes else rotation
                defines = {**write_defines(bound, "cube_"), "GRID_CUBE": 1}
                draw_surfaces(device, frame, perspective_reversed(1.0, 1.0, frame.view.near) @ clip, defines)

        return execute

    return Pass("cube_gbuffer", writes=writes, make=make_cube)


def draw_surfaces(device: Device, frame: FrameState, clip: F64, defines: dict[str, object]) -> None:
    """Draw what the frustum of ``clip`` may see into the bound target, reversed Z."""
    device.ctx.enable_only(moderngl.DEPTH_TEST)
    device.ctx.depth_func = ">"
    moving = "WRITE_MOTION" in defines
    previous_clip = frame.previous.clip_from_relative()

    def program_of(d: Drawable) -> Program:
        features = {f: 1 for f in d.features if f in FEATURES}
        program = device.program("gbuffer.vert", "gbuffer.frag", defines={**defines, **features})
        program.set(clip_from_relative=clip)
        if moving:
            program.set(previous_clip=previous_clip, jitter=frame.jitter)
        return program

    frame.geometry.draw(frame.geometry.visible(clip, frame.view.eye), program_of, frame.view.eye,
                        frame.previous.eye if moving else None, frame.lights.scale)
