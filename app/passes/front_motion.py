"""Motion and depth of what most light of a pixel comes from, which temporal anti-aliasing follows."""

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import make_fullscreen
from app.gl.peeling import PeeledLayer
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex


def declare(nearest: PeeledLayer) -> Pass:
    """The G-buffer's, and those of the nearest layer where more than half of the light comes from it."""
    prefix = nearest.prefix
    opaque, layer = ("motion", "depth"), tuple(prefix + name for name in ("motion", "depth", "passage"))
    volume = tuple(prefix + name for name in ("exit", "volume", "refraction"))

    def make(device: Device, bound: BoundPass) -> Execute:
        draw = make_fullscreen("front_motion.frag", strip=prefix, samplers={name: "opaque_" + name for name in opaque},
                               layer=nearest)(device, bound)

        assert bound.writes == ("front_motion", "front_depth"), "what is copied below is in this order"

        def execute(frame: FrameState, resources: Resources) -> None:
            source = device.ctx.framebuffer([resources[name] for name in opaque])
            device.ctx.copy_framebuffer(resources.target(), source)
            source.release()
            draw(frame, resources)

        return execute

    return Pass("front_motion", reads=(*opaque, *layer), optional=volume,
                writes={"front_motion": Tex("f2", 4), "front_depth": Tex("f4", 1)}, make=make)
