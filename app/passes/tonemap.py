"""The display image of the finished picture."""

from app.gl.frame_state import FrameState
from app.gl.fullscreen import make_fullscreen
from app.graph import Pass, Tex


def declare(source: str, curve: str, has_auto_exposure: bool, size: tuple[int, int]) -> Pass:
    """From the finished picture, of a width and height; ``curve`` is one of ``TONE_MAPS``."""
    def uniforms(frame: FrameState) -> dict[str, object]:
        return {"exposure": frame.exposure_factor if has_auto_exposure else frame.exposure}

    return Pass("tonemap", reads=(source, *(["auto_exposure"] if has_auto_exposure else [])),
                writes={"display": Tex("f1", 4, size=size)},
                make=make_fullscreen("tonemap.frag", uniforms, {f"TONEMAP_{curve.replace('-', '_').upper()}": 1},
                                     samplers={source: "picture"}))
