"""Joint bilateral upsampling of low-resolution light to full resolution."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from app.gl.frame_state import HISTORY, FrameState, MotionKind
from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex

BEFORE = ("motion", "indirect@prev", "normal@prev")
LONGEST = HISTORY[MotionKind.CAMERA]  # frames; nothing tells how old kept light is, so it must not outlive a change


def declare(grid: tuple[int, int], light: str, surface: str, name: str, gathered: bool) -> Pass:
    """From a low-resolution ``grid`` of width and height: ``light_filled``, on ``surface``, into ``light``.

    Parameters
    ----------
    gathered : bool
        Whether pixels that no low-resolution texel shows keep the indirect light that they had.
    """
    def uniforms(frame: FrameState) -> Mapping[str, Any]:
        ratio = {"ratio": (frame.size[0] / grid[0], frame.size[1] / grid[1])}
        history = {"longest": min(HISTORY[frame.motion], LONGEST), "history_valid": frame.history_valid}
        return {**ratio, **history} if gathered else ratio

    samplers = {f"{light}_filled": "light_filled", surface: "lowres_gbuffer"}
    return Pass(name, reads=(*samplers, "normal", "depth", *(BEFORE if gathered else ())),
                writes={light: Tex("f2", 4)}, make=lambda device, bound: make_fullscreen(
                    device, bound, "upsample.frag", uniforms, samplers=samplers))
