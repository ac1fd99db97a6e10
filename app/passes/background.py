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
from app.gl.fullscreen import make_fullscreen
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex
from app.scene import Environment

UNIT = 8  # of the environment's texture, beyond those of what the pass reads


def declare(environment: Environment) -> Pass:
    """Its texture has the scene's scale."""
    return Pass("background", reads=("depth",), writes={"background": Tex("f2", 4)},
                make=lambda device, bound: _make(device, bound, environment))


def _make(device: Device, bound: BoundPass, environment: Environment) -> Callable[[FrameState, Resources], None]:
    texture: list[moderngl.Texture] = []

    def uniforms(frame: FrameState) -> Mapping[str, Any]:
        if not texture:
            texture.append(_upload(device, environment, frame.lights.scale))
        texture[0].use(UNIT)
        texels = 2 * frame.view.tan_half[1] / frame.size[1] * texture[0].height / math.pi  # to a pixel in the middle
        return {"environment": UNIT, "turn": environment.rotation_deg / 360 % 1.0,
                "level": max(0.0, math.log2(max(texels, 1e-30)))}

    return make_fullscreen(device, bound, "background.frag", uniforms)


def _upload(device: Device, environment: Environment, scale: float) -> moderngl.Texture:
    h, w = environment.radiance.shape[:2]
    if max(h, w) > device.max_size:
        raise SceneError(f"an environment of {w}x{h} texels", "the scene JSON",
                         f"expected at most {device.max_size} a side on {device.renderer}")
    pixels = np.minimum(environment.radiance * np.float32(scale), np.finfo(np.float16).max).astype(np.float16)
    texture = device.ctx.texture((w, h), 3, pixels.tobytes(), alignment=1, dtype="f2")
    texture.build_mipmaps()
    texture.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
    texture.repeat_x, texture.repeat_y = True, False
    return texture
