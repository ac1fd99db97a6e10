"""Direct light: diffuse radiance of analytic lights with soft shadows, and specular light where a material has any."""

import moderngl
import numpy as np

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import CUBE_PREFIX, cube_defines, make_fullscreen
from app.gl.lights import LightSet
from app.graph import BoundPass, Pass, Resource, Tex
from app.math3d import R2
from app.paths import data_dir

LTC_UNIT = 15  # texture unit of the table of specular lobes, beyond those of what the pass reads


def declare(lights: LightSet, has_specular: bool) -> Pass:
    """On the screen; specular light only where a material has a specular lobe.

    With TAA each frame samples penumbrae at other points; without it the points are fixed per texel, so that static
    pictures stay static.
    """
    writes: dict[str, Resource] = {"direct": Tex("f2", 4)}
    if has_specular:
        writes["specular"] = Tex("f2", 4)
    reads = ("albedo", "normal", "depth", *lights.shadow_maps, *(("specular_roughness",) if has_specular else ()))
    return Pass("direct", reads=reads, optional=("environment_diffuse", "environment_specular"), writes=writes,
                make=lambda device, bound: _make(device, bound, lights))


def declare_cube(lights: LightSet, face: int, camera_axes: bool) -> Pass:
    """On the cube around the camera; diffuse only, since networks read no specular light."""
    return Pass("cube_direct", reads=("cube_albedo", "cube_normal", "cube_depth", *lights.shadow_maps),
                writes={"cube_direct": Tex("f2", 4, size=(6 * face, face))},
                make=make_fullscreen("direct.frag", lambda frame: {"noise_phase": frame.noise_phase % 1.0},
                                     {**lights.defines, **cube_defines(face, camera_axes)}, CUBE_PREFIX))


def _make(device: Device, bound: BoundPass, lights: LightSet) -> Execute:
    has_lobes = "specular" in bound.writes and "HAS_RECT_LIGHT" in lights.defines
    lobes = _upload_lobes(device) if has_lobes else None

    def uniforms(frame: FrameState) -> dict[str, object]:
        if lobes is not None:
            lobes.use(LTC_UNIT)
        return {"noise_phase": (frame.noise_phase + R2[0] * frame.index * frame.accumulates) % 1.0, "ltc": LTC_UNIT}

    return make_fullscreen("direct.frag", uniforms, lights.defines)(device, bound)


def _upload_lobes(device: Device) -> moderngl.TextureArray:
    """The table of ``shaders/include/ltc.glsl``; its file has shape (roughnesses, angles, layers, 4)."""
    table = np.load(data_dir() / "ltc.npy").transpose(2, 0, 1, 3)
    layers, height, width, components = table.shape
    texture = device.ctx.texture_array((width, height, layers), components, np.ascontiguousarray(table).tobytes(),
                                       dtype="f2")
    texture.filter = moderngl.LINEAR, moderngl.LINEAR
    texture.repeat_x = texture.repeat_y = False
    return texture
