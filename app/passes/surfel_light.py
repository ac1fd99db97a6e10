"""Direct light at the places of world surfels, from the same shadow maps as the picture's."""

from __future__ import annotations

import math
from collections.abc import Callable

import moderngl
import numpy as np

from app.gl.context import Device
from app.gl.frame_state import FrameState
from app.gl.lights import LightSet
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex
from app.surfels.tracked import TrackedSurfels
from app.surfels.world import F32, MAX_LIGHT_SAMPLES


def declare(surfels: TrackedSurfels, lights: LightSet) -> Pass:
    """Moves the surfels, too; keeps its texels while neither they nor the lights change.

    A place takes the four texels of a quad, which search its shadows together.
    """
    columns = math.isqrt(surfels.count * MAX_LIGHT_SAMPLES - 1) + 1
    rows = -(-surfels.count * MAX_LIGHT_SAMPLES // columns)
    return Pass("surfel_light", reads=lights.shadow_maps,
                writes={"surfel_light": Tex("f2", 4, size=(2 * columns, 2 * rows))},
                make=lambda device, bound: make(device, bound, surfels, lights, (columns, rows)))


def make(device: Device, bound: BoundPass, surfels: TrackedSurfels, lights: LightSet,
         layout: tuple[int, int]) -> Callable[[FrameState, Resources], None]:
    program = device.fullscreen("surfel_light.frag", lights.defines)
    textures = {name: device.ctx.texture(layout, 4, dtype="f4") for name in ("light_sample_position", "light_sample_normal")}
    drawn: list[object] = []  # what the texels show

    def execute(frame: FrameState, resources: Resources) -> None:
        surfels.follow(frame.view, frame.geometry.time)
        state = surfels.version, frame.lighting
        if drawn == [state]:
            return
        world = surfels.world
        for unit, (name, values) in enumerate((("light_sample_position", world.light_sample_position),
                                               ("light_sample_normal", world.light_sample_normal))):
            textures[name].write(_laid_out(values, layout).tobytes())
            textures[name].use(len(bound.reads) + unit)
            program.set(**{name: len(bound.reads) + unit})
        resources.target()
        device.ctx.enable_only(moderngl.NOTHING)
        resources.bind(program)
        program.set(noise_phase=frame.noise_phase, local_eye=tuple(frame.view.eye - world.origin))
        device.draw_fullscreen(program)
        drawn[:] = [state]

    return execute


def _laid_out(values: F32, layout: tuple[int, int]) -> F32:
    """Rows of three as texels of four, [h, w, 4], the first at the bottom left; 0 beyond."""
    texels = np.zeros((layout[0] * layout[1], 4), np.float32)
    texels[:len(values), :3] = values
    return texels.reshape(layout[1], layout[0], 4)
