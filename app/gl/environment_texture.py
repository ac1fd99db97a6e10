"""The radiance of an environment for shaders."""

import moderngl
import numpy as np

from app.errors import SceneError
from app.gl.context import Device
from app.scene import Environment


def environment_texture(device: Device, environment: Environment) -> moderngl.Texture:
    """Radiance in half floats with its levels of detail, top row first; rows repeat."""
    h, w = environment.radiance.shape[:2]
    if max(h, w) > device.max_size:
        raise SceneError(f"{w}x{h} texels are too many for {device.renderer}", "environment",
                         f"expected at most {device.max_size} a side")
    pixels = np.minimum(environment.radiance, np.finfo(np.float16).max).astype(np.float16)
    texture = device.ctx.texture((w, h), 3, pixels.tobytes(), alignment=1, dtype="f2")
    texture.build_mipmaps()
    texture.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
    texture.repeat_x, texture.repeat_y = True, False
    return texture
