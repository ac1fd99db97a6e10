"""The exposure that suits the finished picture, followed slowly so that a video does not flicker."""

import math

from app.gl.frame_state import FrameState
from app.gl.fullscreen import make_fullscreen
from app.graph import PREVIOUS, Pass, Tex

ADAPTATION_SECONDS = 0.5
FRAME_SECONDS = 1 / 30
ADAPTATION = 1 - math.exp(-FRAME_SECONDS / ADAPTATION_SECONDS)  # share of the way to the new exposure in one frame


def declare(source: str) -> Pass:
    """From the finished picture, with the scene's scale; one texel."""
    def uniforms(frame: FrameState) -> dict[str, object]:
        return {"adaptation": ADAPTATION if frame.history_valid else 1.0}

    return Pass("auto_exposure", reads=(source, "auto_exposure" + PREVIOUS),
                writes={"auto_exposure": Tex("f4", 1, size=(1, 1))},
                make=make_fullscreen("auto_exposure.frag", uniforms, samplers={source: "picture"}))
