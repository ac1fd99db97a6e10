"""Temporal anti-aliasing, and temporal upsampling where frames are smaller than the image."""

from collections.abc import Callable, Iterator

import numpy as np

from app.arrays import F64
from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import make_fullscreen
from app.gl.pool import Resources
from app.graph import PREVIOUS, BoundPass, Pass, Resource, Tex
from app.math3d import View

MOMENTS = "guide_mean", "guide_deviation"


def declare(has_sky: bool, motion: str, depth: str, is_sharpened: bool, size: tuple[int, int],
            is_upscaled: bool, gathers_reflections: bool) -> Iterator[Pass]:
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
    is_upscaled : bool
        Whether frames are smaller than the image.
    gathers_reflections : bool
        Whether pixels of a still get reflections of their own one after another.
    """
    def uniforms(frame: FrameState) -> dict[str, object]:
        always: dict[str, object] = {"history_valid": frame.history_valid, "near": frame.view.near}
        if not has_sky:
            return always
        # The shader has the view axis in the middle of the image, from where the shears move it.
        rotation = frame.previous.rotation @ frame.view.rotation.T
        return {**always, "previous_lens": frame.previous.half_size,
                "previous_from_view": np.linalg.inv(_shear(frame.previous)) @ rotation @ _shear(frame.view)}

    defines = {"SKY": 1} if has_sky else {}
    if gathers_reflections:
        defines["GATHERS_REFLECTIONS"] = 1

    def reprojecting(shader: str) -> Callable[[Device, BoundPass], Execute]:
        """In variants, so that what frames of a camera at rest need costs nothing while it moves or lights change."""
        def make(device: Device, bound: BoundPass) -> Execute:
            moving, resting, settled = (make_fullscreen(
                shader, uniforms, {**defines, **variant},
                samplers={motion: "motion", depth + PREVIOUS: "depth_prev"})(device, bound)
                for variant in ({}, {"CAMERA_RESTS": 1}, {"SETTLED": 1}))

            def execute(frame: FrameState, resources: Resources) -> None:
                rests = frame.view.same_as(frame.previous) and not frame.relit
                draw = settled if frame.settled else resting if rests else moving
                draw(frame, resources)

            return execute

        return make

    writes: dict[str, Resource] = {"taa": Tex("f4", 4, size=size)}
    if not is_upscaled:
        writes["taa_deviation"] = Tex("f2", 1, size=size)
    if is_sharpened:
        writes["resampled"] = Tex("f2", 1, size=size)
    history = tuple(name + PREVIOUS for name in writes)
    if is_upscaled:
        yield Pass("upscale_guide", reads=("lit", motion, depth + PREVIOUS, *(name + PREVIOUS for name in MOMENTS)),
                   writes=dict.fromkeys((*MOMENTS, "guide_motion"), Tex("f2", 4)),
                   make=reprojecting("upscale_guide.frag"))
        yield Pass("upscale", reads=("lit", *MOMENTS, "guide_motion", *history), writes=writes,
                   make=make_fullscreen("upscale.frag", lambda frame: {
                       "output_image": (*size, 1 / size[0], 1 / size[1]), "history_valid": frame.history_valid,
                       "settled": frame.settled}))
    else:
        yield Pass("taa", reads=("lit", motion, depth + PREVIOUS, *history), writes=writes,
                   make=reprojecting("taa.frag"))


def _shear(view: View) -> F64:
    """Rays of a view whose axis meets the image's middle, to rays of the view, shape (3, 3)."""
    shear = np.eye(3)
    shear[:2, 2] = np.multiply(view.center, view.half_size)
    return shear
