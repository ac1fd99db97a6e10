"""One layer of blended and transmissive surfaces over what is behind it."""

import moderngl

from app.gl.blur_levels import LEVELS, BlurLevels
from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import make_fullscreen
from app.gl.peeling import PeeledLayer
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex
from app.math3d import R2

BLUR_UNITS = {"blur_light": 34, "blur_depth": 35}  # texture units beyond those that one stage can have samplers for


def declare(layer: PeeledLayer, behind: str, result: str, has_indirect: bool, has_arriving: bool,
            has_volumes: bool, blurs: bool, next_depth: str | None) -> Pass:
    """Lay ``layer`` over the resource ``behind``.

    Parameters
    ----------
    has_indirect : bool
        Whether there is indirect light of opaque surfaces, which layers take from around them.
    has_arriving : bool
        Whether layers have diffuse light of their own; that of opaque surfaces, and the sky's without shadows, is for
        what the grid of that light misses.
    has_volumes : bool
        Whether some material is a volume, through which rays are refracted.
    blurs : bool
        Whether some material is rough glass, which blurs what is behind.
    next_depth : str or None
        The depth of the layer behind, which rays through volumes may meet; None without one.
    """
    prefix = layer.prefix
    next_depths = (next_depth,) if has_volumes and next_depth is not None else ()

    def uniforms(frame: FrameState) -> dict[str, object]:
        return {"noise_phase": (frame.noise_phase + R2[1] * frame.index * frame.accumulates) % 1.0, **BLUR_UNITS}

    def make(device: Device, bound: BoundPass) -> Execute:
        samplers = {behind: "behind", "depth": "opaque_depth", **dict.fromkeys(next_depths, "next_depth")}
        defines = {**({"HAS_NEXT_DEPTH": 1} if next_depths else {}), **({"BLUR_LEVELS": LEVELS} if blurs else {})}
        draw = make_fullscreen("blend.frag", uniforms, defines, prefix, samplers, layer)(device, bound)
        source: moderngl.Framebuffer | None = None
        levels: BlurLevels | None = None

        def execute(frame: FrameState, resources: Resources) -> None:
            nonlocal source, levels
            source = source or device.ctx.framebuffer([resources[behind]])
            device.ctx.copy_framebuffer(resources.target(), source)
            if blurs and layer.is_visible:
                levels = levels or BlurLevels(device, resources[behind].size)
                levels.build(resources[behind], resources["depth"])
                levels.light.use(BLUR_UNITS["blur_light"])
                levels.depth.use(BLUR_UNITS["blur_depth"])
            draw(frame, resources)

        return execute

    own = ("albedo", "direct", "depth", "passage", *(("arriving",) if has_arriving else ()),
           *(("normal",) if has_arriving or has_volumes else ()), *(("exit", "volume") if has_volumes else ()))
    others = (behind, "depth", *(("indirect",) if has_indirect else ()), *next_depths)
    own_optional = ("emission", "specular", "refraction")
    # The nearest layer mirrors what is around it.
    others_optional = (*(() if layer.index else ("outer_reflection",)),
                       *(("sky_irradiance",) if has_arriving or has_volumes else ()))
    return Pass(prefix + "blend", reads=(*others, *(prefix + name for name in own)),
                optional=(*others_optional, *(prefix + name for name in own_optional)),
                writes={result: Tex("f2", 4)}, make=make)
