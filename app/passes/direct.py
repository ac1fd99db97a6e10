"""Direct light: diffuse radiance of analytic lights with soft shadows, and specular light where a material has any."""

from app.gl.fullscreen import CUBE_PREFIX, cube_defines, make_fullscreen
from app.gl.lights import LightSet
from app.graph import Pass, Resource, Tex
from app.math3d import R2


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
                make=make_fullscreen("direct.frag", lambda frame: {
                    "noise_phase": (frame.noise_phase + R2[0] * frame.index * frame.accumulates) % 1.0},
                    lights.defines))


def declare_cube(lights: LightSet, face: int, camera_axes: bool) -> Pass:
    """On the cube around the camera; diffuse only, since networks read no specular light."""
    return Pass("cube_direct", reads=("cube_albedo", "cube_normal", "cube_depth", *lights.shadow_maps),
                writes={"cube_direct": Tex("f2", 4, size=(6 * face, face))},
                make=make_fullscreen("direct.frag", lambda frame: {"noise_phase": frame.noise_phase % 1.0},
                                     {**lights.defines, **cube_defines(face, camera_axes)}, CUBE_PREFIX))
