"""Direct light at world surfels: the mean over their light samples, with shadows by maps or rays as in the picture."""

import math

from app.gl.context import Device
from app.gl.direct_light import DirectLight
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import read_defines
from app.gl.lights import LightSet
from app.gl.pool import Resources
from app.gl.shadow_rays import share_of
from app.graph import BoundPass, Buf, Pass
from app.surfels.light_samples import mean_light
from app.surfels.tracked import TrackedSurfels
from app.surfels.world import MAX_LIGHT_SAMPLES

SAMPLES = 8  # shadow rays of a light sample


def declare(surfels: TrackedSurfels, lights: LightSet) -> Pass:
    """The pass also moves the surfels; it keeps their light, irradiance / π, while they and the lights stay."""
    columns = math.isqrt(surfels.count * MAX_LIGHT_SAMPLES - 1) + 1
    rows = -(-surfels.count * MAX_LIGHT_SAMPLES // columns)
    return Pass("surfel_light", reads=lights.shadow_maps,
                writes={"surfel_light": Buf((3, surfels.count), on_host=True)},
                make=lambda device, bound: make(device, bound, surfels, lights, (columns, rows)))


def make(device: Device, bound: BoundPass, surfels: TrackedSurfels, lights: LightSet,
         layout: tuple[int, int]) -> Execute:
    direct = DirectLight(device, lights, read_defines(bound), layout, surfels.caster)

    def execute(frame: FrameState, resources: Resources) -> None:
        surfels.update(frame.view, frame.geometry.time, frame.viewpoints)
        if frame.stands_alone:
            surfels.forget_lookup()
        key = surfels.version, frame.lighting, resources.read_stamps()
        if resources.is_current(key):
            return
        world = surfels.world
        direct.place(world.light_sample_position, world.light_sample_normal)
        traced = direct.trace(frame, range(SAMPLES))
        drawn = direct.draw(frame, resources, None if traced is None else share_of(*traced))
        light = mean_light(drawn, world) + world.sky_irradiance + world.proxy_irradiance
        resources.write_array("surfel_light", light.T)
        resources.set_current(key)

    return execute
