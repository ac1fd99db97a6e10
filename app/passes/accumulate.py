"""Temporal accumulation of the demodulated indirect light, at low resolution."""

from app.gl.context import Device
from app.gl.frame_state import MAX_HISTORY, Execute, FrameState, MotionKind
from app.gl.fullscreen import make_fullscreen, ratio_to
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex

STILL_FRAMES = MAX_HISTORY[MotionKind.NONE]


def declare(grid: tuple[int, int], noisy: bool = False, still_frames: float = STILL_FRAMES) -> Pass:
    """Over a low-resolution ``grid`` of width and height; the history is 32-bit like that of TAA.

    Parameters
    ----------
    noisy : bool
        Whether texels differ strongly from frame to frame, so that a mean of many of them validates the history.
    still_frames : float
        Of history where nothing moves.
    """
    return Pass("accumulate",
                reads=("indirect_now", "lowres_gbuffer", "motion", "indirect_low@prev", "lowres_gbuffer@prev"),
                writes={"indirect_low": Tex("f4", 4, size=grid)},
                make=lambda device, bound: make(device, bound, grid, noisy, still_frames))


def make(device: Device, bound: BoundPass, grid: tuple[int, int], noisy: bool, still_frames: float) -> Execute:
    max_frames = {**MAX_HISTORY, MotionKind.NONE: still_frames}
    draw = make_fullscreen("accumulate.frag", lambda frame: {
        "ratio": ratio_to(grid, frame), "max_frames": max_frames[frame.motion],
        "history_valid": frame.history_valid}, {"NOISY": 1} if noisy else {})(device, bound)

    def execute(frame: FrameState, resources: Resources) -> None:
        if noisy:
            resources["indirect_now"].build_mipmaps()
        draw(frame, resources)

    return execute
