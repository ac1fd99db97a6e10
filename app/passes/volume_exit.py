"""Where light that enters a volume at a layer may leave it: the nearest back behind, of the layer's material."""

import moderngl

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import write_defines
from app.gl.peeling import PeeledLayer
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex

UNITS = {"depth": 0, "refraction": 1}  # texture units


def declare(layer: PeeledLayer) -> Pass:
    """Normals and depths; nothing where no back is known, as of open surfaces."""
    prefix = layer.prefix

    def make(device: Device, bound: BoundPass) -> Execute:
        defines = {"LABELS": 1, **write_defines(bound.writes, prefix)}

        def execute(frame: FrameState, resources: Resources) -> None:
            clip, geometry = frame.view.clip_from_relative(frame.jitter), frame.geometry
            program = device.program("gbuffer.vert", "volume_exit.frag", defines=defines)
            program.set(clip_from_relative=clip, **UNITS)
            for sampler, unit in UNITS.items():
                resources[prefix + sampler].use(unit)
            target = resources.target(with_depth=True)
            target.clear(depth=0.0)
            device.ctx.enable_only(moderngl.DEPTH_TEST)
            device.ctx.depth_func = ">"
            with layer.within(target, frame):
                geometry.draw(geometry.visible(clip, frame.view.eye) & geometry.is_volume, lambda features: program,
                              frame.view.eye, only_backs=True)

        return execute

    return Pass(prefix + "exit", reads=(prefix + "depth", prefix + "refraction"),
                writes={prefix + "exit": Tex("f4", 4)}, make=make)
