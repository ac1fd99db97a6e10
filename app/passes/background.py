"""The environment where no surface is seen."""

import math
from collections.abc import Mapping

from app.gl.context import Device
from app.gl.environment_texture import environment_texture
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import CUBE_PREFIX, cube_defines, make_fullscreen
from app.graph import BoundPass, Pass, Tex
from app.scene import Environment

UNIT = 8  # texture unit of the environment, beyond those of what the pass reads


def declare(environment: Environment) -> Pass:
    """On the screen."""
    return Pass("background", reads=("depth",), writes={"background": Tex("f2", 4)},
                make=lambda device, bound: _make(device, bound, environment, {}, None))


def declare_cube(environment: Environment, face: int, camera_axes: bool) -> Pass:
    """On the cube around the camera, an atlas row of faces with ``face`` texels a side."""
    return Pass("cube_background", reads=("cube_depth",),
                writes={"cube_background": Tex("f2", 4, size=(6 * face, face))},
                make=lambda device, bound: _make(device, bound, environment, cube_defines(face, camera_axes), face))


def _make(device: Device, bound: BoundPass, environment: Environment, grid: Mapping[str, object],
          face: int | None) -> Execute:
    """``face`` texels span 90°; with None, the screen's rows span the camera's field of view."""
    texture = environment_texture(device, environment)
    texels_per_radian = max(texture.height / math.pi, texture.width / (2 * math.pi))

    def uniforms(frame: FrameState) -> dict[str, object]:
        texture.use(UNIT)
        # Radians, at the centre of the view; all pixels of an orthographic view show the same direction.
        view = frame.view
        pixel = 2 / face if face else 0.0 if view.is_orthographic else 2 * view.half_size[1] / frame.size[1]
        return {"environment": UNIT, "rotation": environment.rotation_deg / 360 % 1.0,
                "level": math.log2(max(pixel * texels_per_radian, 1.0))}

    return make_fullscreen("background.frag", uniforms, grid, CUBE_PREFIX)(device, bound)
