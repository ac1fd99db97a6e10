"""Direct light at world surfels: the mean over their light samples, with shadows by maps or rays as in the picture."""

import math
from collections.abc import Mapping

import moderngl
import numpy as np

from app.arrays import F32
from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import read_defines
from app.gl.lights import LightSet
from app.gl.pool import Resources
from app.gl.shader import Program
from app.gl.shadow_rays import ShadowRays, share_of
from app.graph import BoundPass, Buf, Pass
from app.surfels.light_samples import mean_light
from app.surfels.tracked import TrackedSurfels
from app.surfels.world import MAX_LIGHT_SAMPLES

SAMPLES = 16  # shadow rays of a light sample


def declare(surfels: TrackedSurfels, lights: LightSet) -> Pass:
    """The pass also moves the surfels; it keeps their light, irradiance / π, while neither they nor the lights change.

    A light sample takes the four texels of a quad, which search its shadows together.
    """
    columns = math.isqrt(surfels.count * MAX_LIGHT_SAMPLES - 1) + 1
    rows = -(-surfels.count * MAX_LIGHT_SAMPLES // columns)
    return Pass("surfel_light", reads=lights.shadow_maps,
                writes={"surfel_light": Buf((3, surfels.count), on_host=True)},
                make=lambda device, bound: make(device, bound, surfels, lights, (columns, rows)))


def make(device: Device, bound: BoundPass, surfels: TrackedSurfels, lights: LightSet,
         layout: tuple[int, int]) -> Execute:
    program = device.fullscreen("surfel_light.frag", {**lights.defines, **read_defines(bound)})
    texels = device.ctx.texture((2 * layout[0], 2 * layout[1]), 4, dtype="f2")
    target = device.ctx.framebuffer([texels])
    names = "light_sample_position", "light_sample_normal", "light_sample_visibility"
    textures = {name: device.ctx.texture(layout, 4, dtype="f4") for name in names}
    rays = (ShadowRays(device, layout, {**lights.defines, "GRID_SURFELS": 1}, surfels.caster)
            if lights.has_traced else None)

    def execute(frame: FrameState, resources: Resources) -> None:
        surfels.update(frame.view, frame.geometry.time, frame.viewpoints)
        if frame.viewpoints and not frame.history_valid:
            surfels.forget_lookup()  # so that the frame depends on no other
        key = surfels.version, frame.lighting, resources.read_stamps()
        if resources.is_current(key):
            return
        world = surfels.world
        position, normal, visibility = textures.values()
        position.write(_as_texels(world.light_sample_position, layout).tobytes())
        normal.write(_as_texels(world.light_sample_normal, layout).tobytes())
        local_eye = tuple(frame.view.eye - world.origin)
        if rays is not None:
            _bind(rays.program, {name: textures[name] for name in names[:2]}, 0)
            rays.program.set(local_eye=local_eye)
            visibility.write(share_of(*rays.trace(frame, range(SAMPLES))).tobytes())
        target.use()
        device.ctx.enable_only(moderngl.NOTHING)
        resources.bind(program)
        _bind(program, textures, len(bound.reads))
        program.set(noise_phase=frame.noise_phase, local_eye=local_eye)
        device.draw_fullscreen(program)
        drawn = np.frombuffer(texels.read(alignment=1), np.float16).astype(np.float32)
        light = mean_light(drawn.reshape(texels.height, texels.width, 4), world) + world.sky_irradiance
        resources.write_array("surfel_light", light.T)
        resources.set_current(key)

    return execute


def _bind(program: Program, textures: Mapping[str, moderngl.Texture], first_unit: int) -> None:
    """Bind textures to the samplers of their names, in the units from the first one on."""
    for unit, (name, texture) in enumerate(textures.items(), first_unit):
        texture.use(unit)
        program.set(**{name: unit})


def _as_texels(rows: F32, layout: tuple[int, int]) -> F32:
    """Rows of three as texels of four, [h, w, 4], the first at the bottom left; 0 beyond the last."""
    texels = np.zeros((layout[0] * layout[1], 4), np.float32)
    texels[:len(rows), :3] = rows
    return texels.reshape(layout[1], layout[0], 4)
