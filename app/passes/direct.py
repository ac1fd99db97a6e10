"""Direct light: diffuse radiance of lights with shadows, and specular light where a material has any."""

from collections.abc import Mapping

from app.gl.frame_state import FrameState
from app.gl.fullscreen import CUBE_PREFIX, cube_defines, make_fullscreen, ratio_to
from app.gl.lights import LightSet
from app.graph import Pass, Resource, Tex
from app.math3d import R2


def declare(lights: LightSet, has_specular: bool, shadow_grid: tuple[int, int] | None, has_sky: bool) -> Pass:
    """On the screen; specular light only where a material has a specular lobe.

    With TAA each frame samples penumbrae at other points; without it the points are fixed per texel, so that static
    pictures stay static.

    Parameters
    ----------
    shadow_grid : tuple of int or None
        Width and height of the grid of traced shadows; None where there are none.
    has_sky : bool
        Whether the environment is direct light with traced shadows.
    """
    writes: dict[str, Resource] = {"direct": Tex("f2", 4)}
    if has_specular:
        writes["specular"] = Tex("f2", 4)
    reads = ("albedo", "normal", "depth", *lights.shadow_maps, *(("specular_roughness",) if has_specular else ()),
             *(("shadow_ratio", "shadow_gbuffer") if shadow_grid is not None else ()),
             *(("sky_irradiance",) if has_sky else ()), *(("sky_specular",) if has_sky and has_specular else ()))

    def uniforms(frame: FrameState) -> Mapping[str, object]:
        noise = {"noise_phase": (frame.noise_phase + R2[0] * frame.index * frame.accumulates) % 1.0}
        return noise if shadow_grid is None else {**noise, "shadow_grid_ratio": ratio_to(shadow_grid, frame)}

    return Pass("direct", reads=reads, optional=("environment_diffuse", "environment_specular"), writes=writes,
                make=make_fullscreen("direct.frag", uniforms, lights.defines))


def declare_cube(lights: LightSet, face: int, camera_axes: bool, is_traced: bool, has_sky: bool) -> Pass:
    """On the cube around the camera; diffuse only, since networks read no specular light."""
    reads = ("cube_albedo", "cube_normal", "cube_depth", *lights.shadow_maps,
             *(("cube_shadow_ratio",) if is_traced else ()), *(("sky_irradiance",) if has_sky else ()))
    defines = {**lights.defines, **cube_defines(face, camera_axes), **({"HAS_SHADOW_RATIO": 1} if is_traced else {})}
    return Pass("cube_direct", reads=reads, writes={"cube_direct": Tex("f2", 4, size=(6 * face, face))},
                make=make_fullscreen("direct.frag", lambda frame: {"noise_phase": frame.noise_phase % 1.0}, defines,
                                     CUBE_PREFIX))
