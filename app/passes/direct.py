"""Direct light: diffuse radiance from analytic lights with soft shadows, and highlights where a material has them."""

from __future__ import annotations

from app.gl.fullscreen import SURROUND, cube_defines, make_fullscreen
from app.gl.lights import LightSet
from app.graph import Pass, Resource, Tex
from app.math3d import R2

TURN = R2[0]  # of the noise from frame to frame


def declare(lights: LightSet, shiny: bool) -> Pass:
    """On the screen; highlights only where the scene is ``shiny``.

    Where TAA gathers frames, each samples penumbras at other points; otherwise these are fixed per texel, so that still
    pictures stay still.
    """
    writes: dict[str, Resource] = {"direct": Tex("f2", 4)}
    if shiny:
        writes["specular"] = Tex("f2", 4)
    reads = ("albedo", "normal", "depth", *lights.shadow_maps, *(("gloss",) if shiny else ()))
    return _pass("direct", reads, writes, lights, {}, TURN, ("environment_diffuse", "environment_specular"))


def declare_surround(lights: LightSet, face: int, camera_axes: bool) -> Pass:
    """On the six views around the camera; diffuse only, since highlights don't spread to other surfaces."""
    reads = ("surround_albedo", "surround_normal", "surround_depth", *lights.shadow_maps)
    return _pass("surround_direct", reads, {"surround_direct": Tex("f2", 4, size=(6 * face, face))}, lights,
                 cube_defines(face, camera_axes))


def _pass(name: str, reads: tuple[str, ...], writes: dict[str, Resource], lights: LightSet,
          grid: dict[str, object], turn: float = 0.0, optional: tuple[str, ...] = ()) -> Pass:
    return Pass(name, reads=reads, optional=optional, writes=writes, make=lambda device, bound: make_fullscreen(
        device, bound, "direct.frag", lambda frame: {
            "noise_phase": (frame.noise_phase + turn * frame.index * frame.gathered) % 1.0},
        {**lights.defines, **grid}, SURROUND))
