"""Temporal anti-aliasing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from app.gl.frame_state import FrameState
from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare(sky: bool) -> Pass:
    """The history is 32-bit: hundreds of still frames accumulate in it. ``sky``: whether the sky shows anything."""
    def uniforms(frame: FrameState) -> Mapping[str, Any]:
        found: dict[str, Any] = {"history_valid": frame.history_valid, "near": frame.view.near}
        if sky:
            found |= {"before_from_view": frame.previous.rotation @ frame.view.rotation.T,
                      "lens_before": frame.previous.tan_half}
        return found

    return Pass("taa", reads=("lit", "motion", "taa@prev", "depth@prev"), writes={"taa": Tex("f4", 4)},
                make=lambda device, bound: make_fullscreen(device, bound, "taa.frag", uniforms,
                                                           {"SKY": 1} if sky else {}))
