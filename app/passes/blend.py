"""One layer of blended and transmissive surfaces over what is behind it."""

import moderngl

from app.gl.blur_levels import UNITS, BlurLevels
from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import make_fullscreen
from app.gl.peeling import PeeledLayer
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex
from app.math3d import R2


def declare(layer: PeeledLayer, behind: str, result: str, has_indirect: bool, has_arriving: bool,
            has_volumes: bool, levels: BlurLevels | None, next_depth: str | None) -> Pass:
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
    levels : BlurLevels or None
        By which rough glass blurs what is behind; None if no material is such glass.
    next_depth : str or None
        The depth of the layer behind, which rays through volumes may meet; None without one.
    """
    prefix = layer.prefix
    next_depths = (next_depth,) if has_volumes and next_depth is not None else ()

    def uniforms(frame: FrameState) -> dict[str, object]:
        phase = (frame.noise_phase + R2[1] * frame.index * frame.accumulates) % 1.0
        return {"noise_phase": phase, **({"blur_levels": levels.count, **UNITS} if levels is not None else {})}

    def make(device: Device, bound: BoundPass) -> Execute:
        samplers = {behind: "behind", "depth": "opaque_depth", **dict.fromkeys(next_depths, "next_depth")}
        defines = {**({"HAS_NEXT_DEPTH": 1} if next_depths else {}), **({"BLURS": 1} if levels is not None else {})}
        draw = make_fullscreen("blend.frag", uniforms, defines, prefix, samplers, layer)(device, bound)
        source: moderngl.Framebuffer | None = None

        def execute(frame: FrameState, resources: Resources) -> None:
            nonlocal source
            source = source or device.ctx.framebuffer([resources[behind]])
            device.ctx.copy_framebuffer(resources.target(), source)
            if levels is not None and layer.is_visible:
                levels.build(device, resources[behind], resources["depth"], resources[prefix + "depth"])
                levels.bind()
            draw(frame, resources)

        return execute

    own = ("albedo", "direct", "depth", "passage", *(("arriving",) if has_arriving else ()),
           *(("mirrored",) if has_arriving and layer.index else ()),
           *(("normal",) if has_arriving or has_volumes else ()), *(("exit", "volume") if has_volumes else ()))
    others = (behind, "depth", *(("indirect",) if has_indirect else ()), *next_depths)
    own_optional = ("emission", "specular", "refraction", *(("specular_roughness",) if layer.index else ()))
    # The nearest layer mirrors what is around it.
    others_optional = (*(() if layer.index else ("outer_reflection",)),
                       *(("sky_irradiance",) if has_arriving or has_volumes else ()))
    return Pass(prefix + "blend", reads=(*others, *(prefix + name for name in own)),
                optional=(*others_optional, *(prefix + name for name in own_optional)),
                writes={result: Tex("f2", 4)}, make=make)
