"""Normal and depth on a low-resolution grid: one texel represents those around it; none are averaged."""

from app.gl.fullscreen import make_fullscreen, ratio_to
from app.graph import Pass, Tex


def declare(name: str, grid: tuple[int, int], normals: str = "normal", depths: str = "depth",
            is_sparse: bool = False, least_glow: float | None = None) -> Pass:
    """Over a low-resolution ``grid`` of width and height; pass and resource are called ``name``.

    ``normals`` and ``depths`` are what texels get: ``smooth_normal`` where normals of one surface must be alike,
    whatever its bumps. In what is ``is_sparse``, texels get one of the pixels around that show something.
    ``least_glow`` leaves out lamps that emit more radiance: things right before one would get the light that arrives
    there.
    """
    leaves_out_lamps = least_glow is not None
    glow = {"least_glow": least_glow} if leaves_out_lamps else {}
    return Pass(name, reads=(normals, depths), optional=("emission",) if leaves_out_lamps else (),
                writes={name: Tex("f4", 4, size=grid)},
                make=make_fullscreen("lowres_gbuffer.frag", lambda frame: {"ratio": ratio_to(grid, frame), **glow},
                                     {"HAS_NORMAL": 1, "HAS_DEPTH": 1, **({"SPARSE": 1} if is_sparse else {}),
                                      **({"WITHOUT_LAMPS": 1} if leaves_out_lamps else {})},
                                     samplers={normals: "normal", depths: "depth"}))
