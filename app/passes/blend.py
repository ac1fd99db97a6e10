"""One layer of blended and transmissive surfaces over what is behind it."""

import moderngl

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import make_fullscreen
from app.gl.peeling import PeeledLayer
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex
from app.math3d import R2


def declare(layer: PeeledLayer, behind: str, result: str, has_indirect: bool, has_arriving: bool) -> Pass:
    """Lay ``layer`` over the resource ``behind``.

    What rough surfaces transmit is blurred by mipmaps of ``behind``.

    Parameters
    ----------
    has_indirect : bool
        Whether there is indirect light of opaque surfaces, which layers take from around them.
    has_arriving : bool
        Whether layers have diffuse light of their own; that of opaque surfaces, and the sky's without shadows, is for
        what the grid of that light misses.
    """
    prefix = layer.prefix

    def uniforms(frame: FrameState) -> dict[str, object]:
        return {"noise_phase": (frame.noise_phase + R2[1] * frame.index * frame.accumulates) % 1.0}

    def make(device: Device, bound: BoundPass) -> Execute:
        has_refraction = prefix + "refraction" in bound.reads
        samplers = {behind: "behind", "depth": "opaque_depth"}
        draw = make_fullscreen("blend.frag", uniforms, strip=prefix, samplers=samplers, layer=layer)(device, bound)
        source: moderngl.Framebuffer | None = None

        def execute(frame: FrameState, resources: Resources) -> None:
            nonlocal source
            source = source or device.ctx.framebuffer([resources[behind]])
            device.ctx.copy_framebuffer(resources.target(), source)
            if has_refraction and layer.is_visible:
                texture = resources[behind]
                texture.build_mipmaps()
                texture.filter = moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR
            draw(frame, resources)

        return execute

    # The nearest layer mirrors what is around it.
    shared = (*(() if layer.index else ("outer_reflection",)), *(("sky_irradiance",) if has_arriving else ()))
    own = ("albedo", "direct", "depth", "passage", *(("arriving", "normal") if has_arriving else ()))
    optional = ("emission", "specular", "refraction")
    return Pass(prefix + "blend", reads=(behind, "depth", *(prefix + name for name in own),
                                         *(("indirect",) if has_indirect else ())),
                optional=(*(prefix + name for name in optional), *shared), writes={result: Tex("f2", 4)}, make=make)
