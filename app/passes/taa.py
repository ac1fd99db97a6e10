"""Temporal anti-aliasing."""

import numpy as np

from app.arrays import F64
from app.gl.frame_state import FrameState
from app.gl.fullscreen import make_fullscreen
from app.graph import PREVIOUS, Pass, Resource, Tex
from app.math3d import View


def declare(has_sky: bool, motion: str, depth: str, is_sharpened: bool, size: tuple[int, int]) -> Pass:
    """The history is 32-bit, since hundreds of static frames accumulate in it.

    Parameters
    ----------
    has_sky : bool
        Whether an environment is visible where no surface is, so that the sky needs motion too.
    motion, depth : str
        The resources that say how the visible surfaces move.
    is_sharpened : bool
        Whether ``sharpen`` follows, which needs to know how often the history was resampled.
    size : tuple of int
        Width and height of the image.
    """
    def uniforms(frame: FrameState) -> dict[str, object]:
        always: dict[str, object] = {"history_valid": frame.history_valid, "near": frame.view.near,
                                     "settled": frame.settled}
        if not has_sky:
            return always
        # The shader has the view axis in the middle of the image, from where the shears move it.
        rotation = frame.previous.rotation @ frame.view.rotation.T
        return {**always, "previous_lens": frame.previous.half_size,
                "previous_from_view": np.linalg.inv(_shear(frame.previous)) @ rotation @ _shear(frame.view)}

    previous = depth + PREVIOUS
    defines = {"SKY": 1} if has_sky else {}
    samplers = {motion: "motion", previous: "depth_prev"}
    writes: dict[str, Resource] = {"taa": Tex("f4", 4, size=size)}
    if is_sharpened:
        writes["resampled"] = Tex("f2", 1, size=size)
    history = tuple(name + PREVIOUS for name in writes)
    return Pass("taa", reads=("lit", motion, previous, *history), writes=writes,
                make=make_fullscreen("taa.frag", uniforms, defines, samplers=samplers))


def _shear(view: View) -> F64:
    """Rays of a view whose axis meets the image's middle, to rays of the view, shape (3, 3)."""
    shear = np.eye(3)
    shear[:2, 2] = np.multiply(view.center, view.half_size)
    return shear
