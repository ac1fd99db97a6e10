"""The G-buffer: attributes of the nearest surface in every texel of the screen, or of the cube around the camera."""

import moderngl

from app.arrays import F64
from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import write_defines
from app.gl.geometry import Drawable
from app.gl.pool import Resources
from app.gl.shader import Program
from app.graph import BoundPass, Pass, Resource, Tex
from app.math3d import affine_matrix, cube_rotations, perspective_reversed
from app.scene import Scene

FEATURES = ("ALBEDO_MAP", "EMISSION_MAP", "VERTEX_COLOR", "ALPHA_MASK")


def gbuffer_targets(scene: Scene, size: tuple[int, int] | None = None) -> dict[str, Resource]:
    """What a G-buffer of ``scene`` can hold; nothing that the scene does not need."""
    color = Tex("f2", 4, size=size)
    targets: dict[str, Resource] = {"albedo": color, "normal": color, "depth": Tex("f4", 1, size=size)}
    if any(m.emits for m in scene.materials):
        targets["emission"] = color
    if any(m.has_specular for m in scene.materials):
        targets["specular_roughness"] = color
    return targets


def declare(scene: Scene) -> Pass:
    """The screen's G-buffer."""
    return Pass("gbuffer", writes={**gbuffer_targets(scene), "motion": Tex("f2", 4)}, make=make)


def make(device: Device, bound: BoundPass) -> Execute:
    def execute(frame: FrameState, resources: Resources) -> None:
        target = resources.target(with_depth=True)
        target.clear(depth=0.0)
        draw_surfaces(device, frame, frame.view.clip_from_relative(frame.jitter), write_defines(bound))

    return execute


def declare_cube(scene: Scene, face: int, camera_axes: bool) -> Pass:
    """The cube's G-buffer: an atlas row of faces with ``face`` texels a side, in contract order."""
    writes = {f"cube_{name}": tex for name, tex in gbuffer_targets(scene, (6 * face, face)).items()}

    def make_cube(device: Device, bound: BoundPass) -> Execute:
        rotations = cube_rotations()

        def execute(frame: FrameState, resources: Resources) -> None:
            target = resources.target(with_depth=True)
            target.viewport = (0, 0, *target.size)
            target.clear(depth=0.0)
            for index, rotation in enumerate(rotations):
                target.viewport = (index * face, 0, face, face)
                axes = affine_matrix(rotation @ frame.view.rotation if camera_axes else rotation)
                defines = {**write_defines(bound, "cube_"), "GRID_CUBE": 1}
                draw_surfaces(device, frame, perspective_reversed(1.0, 1.0, frame.view.near) @ axes, defines)

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
                        frame.previous.eye if moving else None)
