"""Temporal anti-aliasing."""

from app.gl.frame_state import FrameState
from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare(has_sky: bool) -> Pass:
    """The history is 32-bit, since hundreds of static frames accumulate in it.

    Parameters
    ----------
    has_sky : bool
        Whether an environment is visible where no surface is, so that the sky needs motion too.
    """
    def uniforms(frame: FrameState) -> dict[str, object]:
        always: dict[str, object] = {"history_valid": frame.history_valid, "near": frame.view.near,
                                     "settled": frame.settled}
        if not has_sky:
            return always
        return {**always, "previous_from_view": frame.previous.rotation @ frame.view.rotation.T,
                "previous_lens": frame.previous.tan_half}

    return Pass("taa", reads=("lit", "motion", "taa@prev", "depth@prev"), writes={"taa": Tex("f4", 4)},
                make=make_fullscreen("taa.frag", uniforms, {"SKY": 1} if has_sky else {}))
