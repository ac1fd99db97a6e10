"""Direct light: diffuse radiance from analytic lights with soft shadows, and highlights where a material has them."""

from __future__ import annotations

from app.gl.fullscreen import CUBE_PREFIX, cube_defines, make_fullscreen
from app.gl.lights import LightSet
from app.graph import Pass, Resource, Tex
from app.math3d import R2

TURN = R2[0]  # of the noise from frame to frame


def declare(lights: LightSet, has_specular: bool) -> Pass:
    """On the screen; highlights only where the scene is ``has_specular``.

    Where TAA gathers frames, each samples penumbras at other points; otherwise these are fixed per texel, so that still
    pictures stay still.
    """
    writes: dict[str, Resource] = {"direct": Tex("f2", 4)}
    if has_specular:
        writes["specular"] = Tex("f2", 4)
    reads = ("albedo", "normal", "depth", *lights.shadow_maps, *(("specular_roughness",) if has_specular else ()))
    return _pass("direct", reads, writes, lights, {}, TURN, ("environment_diffuse", "environment_specular"))


def declare_cube(lights: LightSet, face: int, camera_axes: bool) -> Pass:
    """On the six views around the camera; diffuse only, since highlights don't spread to other surfaces."""
    reads = ("cube_albedo", "cube_normal", "cube_depth", *lights.shadow_maps)
    return _pass("cube_direct", reads, {"cube_direct": Tex("f2", 4, size=(6 * face, face))}, lights,
                 cube_defines(face, camera_axes))


def _pass(name: str, reads: tuple[str, ...], writes: dict[str, Resource], lights: LightSet,
          grid: dict[str, object], turn: float = 0.0, optional: tuple[str, ...] = ()) -> Pass:
    return Pass(name, reads=reads, optional=optional, writes=writes, make=lambda device, bound: make_fullscreen(
        device, bound, "direct.frag", lambda frame: {
            "noise_phase": (frame.noise_phase + turn * frame.index * frame.gathered) % 1.0},
        {**lights.defines, **grid}, CUBE_PREFIX))
