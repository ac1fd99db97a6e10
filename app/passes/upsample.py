"""Joint bilateral upsampling of low-resolution light to full resolution."""

from functools import partial

from app.gl.frame_state import MAX_HISTORY, FrameState, MotionKind
from app.gl.fullscreen import make_fullscreen, quads_share_taps, ratio_to
from app.graph import Pass, Tex

HISTORY_READS = "motion", "indirect@prev"
MISSED_READS = ("missed_surface", "missed_light")
# The history's age is not stored, so it must not outlive a change of light.
MAX_FRAMES = MAX_HISTORY[MotionKind.CAMERA]


def declare(name: str, grid: tuple[int, int], light: str, surface: str, target: str, has_history: bool = False,
            missed_tile: int | None = None, normals: str = "normal", gradient: str | None = None) -> Pass:
    """From a low-resolution ``grid`` of width and height: ``light`` on the G-buffer ``surface`` becomes ``target``.

    Parameters
    ----------
    has_history : bool
        Whether pixels whose surface no low-resolution texel shows keep the indirect light of earlier frames.
    missed_tile : int or None
        Side in pixels of the tiles of the image in which one of these pixels may have light of its own.
    normals : str
        Those of the image; ``surface`` has them too.
    gradient : str, optional
        On the grid: how light changes as bumps tilt, over the light.
    """
    def uniforms(frame: FrameState) -> dict[str, object]:
        ratio: dict[str, object] = {"ratio": ratio_to(grid, frame)}
        if not has_history:
            return ratio
        return {**ratio, "max_frames": min(MAX_HISTORY[frame.motion], MAX_FRAMES), "history_valid": frame.history_valid,
                "near": frame.view.near}

    samplers = {light: "light_filled", surface: "lowres_gbuffer", normals: "normal",
                **({normals + "@prev": "normal_prev"} if has_history else {})}
    if gradient is not None:
        samplers |= {gradient: "light_gradient", "normal": "bumpy_normal"}
    reads = (*(HISTORY_READS if has_history else ()), *(MISSED_READS if missed_tile else ()))
    return Pass(name, reads=(*samplers, "depth", *reads), writes={target: Tex("f2", 4)},
                make=make_fullscreen("upsample.frag", uniforms, {"TILE": missed_tile} if missed_tile else {},
                                     samplers=samplers, fast_path=partial(quads_share_taps, grid)))
