"""The environment where no surface is seen."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import moderngl
import numpy as np

from app.errors import SceneError
from app.gl.context import Device
from app.gl.frame_state import FrameState
from app.gl.fullscreen import CUBE_PREFIX, cube_defines, make_fullscreen
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex
from app.scene import Environment

UNIT = 8  # of the environment's texture, beyond those of what the pass reads


def declare(environment: Environment, scale: float) -> Pass:
    """On the screen; radiance is multiplied by ``scale``, the scene's."""
    return Pass("background", reads=("depth",), writes={"background": Tex("f2", 4)},
                make=lambda device, bound: _make(device, bound, environment, scale, {}, None))


def declare_cube(environment: Environment, scale: float, face: int, camera_axes: bool) -> Pass:
    """On the six views around the camera, an atlas row of faces with ``face`` texels a side."""
    return Pass("cube_background", reads=("cube_depth",),
                writes={"cube_background": Tex("f2", 4, size=(6 * face, face))},
                make=lambda device, bound: _make(device, bound, environment, scale,
                                                 cube_defines(face, camera_axes), face))


def _make(device: Device, bound: BoundPass, environment: Environment, scale: float, grid: Mapping[str, object],
          face: int | None) -> Callable[[FrameState, Resources], None]:
    """``face`` texels show 90°; without, the screen's rows show the camera's field of view."""
    texture = _upload(device, environment, scale)
    texels_per_radian = max(texture.height / math.pi, texture.width / (2 * math.pi))

    def uniforms(frame: FrameState) -> Mapping[str, Any]:
        texture.use(UNIT)
        pixel = 2 / face if face else 2 * frame.view.tan_half[1] / frame.size[1]  # radians, in the middle of the view
        return {"environment": UNIT, "turn": environment.rotation_deg / 360 % 1.0,
                "level": math.log2(max(pixel * texels_per_radian, 1.0))}

    return make_fullscreen(device, bound, "background.frag", uniforms, grid, CUBE_PREFIX)


def _upload(device: Device, environment: Environment, scale: float) -> moderngl.Texture:
    h, w = environment.radiance.shape[:2]
    if max(h, w) > device.max_size:
        raise SceneError(f"an environment of {w}x{h} texels", "the scene",
                         f"expected at most {device.max_size} a side on {device.renderer}")
    pixels = np.minimum(environment.radiance * np.float32(scale), np.finfo(np.float16).max).astype(np.float16)
    texture = device.ctx.texture((w, h), 3, pixels.tobytes(), alignment=1, dtype="f2")
    texture.build_mipmaps()
    texture.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
    texture.repeat_x, texture.repeat_y = True, False
    return texture
