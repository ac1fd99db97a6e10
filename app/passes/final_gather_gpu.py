"""Gathered light on the GPU alone: what ``final_gather`` and app/surfels/final_gather.py do with rays on the CPU.

For each sample of the texels a shader traces a ray, and a second one where the first ends nearby; direct light is drawn
where they end; and another shader adds what surfels send there, and what surfaces emit and reflect.
"""

import math
from collections.abc import Mapping

import numpy as np

from app.gl.compute import run_over_grid
from app.gl.context import Device
from app.gl.direct_light import DirectLight
from app.gl.frame_state import Execute, FrameState
from app.gl.fullscreen import ratio_to, read_defines
from app.gl.lights import LightSet
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Resource
from app.passes.gather_turns import turns_of
from app.passes.surfel_buffer import SurfelBuffer
from app.surfels.final_gather import spread_evenly
from app.surfels.tracked import TrackedSurfels

TRACED_SIDE = 8  # texels along the edges of what a work group of gather_trace.comp traces


def declare(surfels: TrackedSurfels, lights: LightSet, surfaces: str, writes: Mapping[str, Resource],
            grid: tuple[int, int], has_history: bool) -> Pass:
    """The pass that gathers light, and light between surfels, for what the texture ``surfaces`` shows."""
    return Pass("gather_rays", reads=(surfaces, "surfel_indirect", *lights.shadow_maps), writes=writes,
                make=lambda device, bound: make(device, bound, surfels, lights, surfaces, tuple(writes), grid,
                                                has_history))


def make(device: Device, bound: BoundPass, surfels: TrackedSurfels, lights: LightSet, surfaces: str,
         names: tuple[str, ...], grid: tuple[int, int], has_history: bool) -> Execute:
    rays = surfels.caster.shader_rays
    assert rays is not None
    ends = grid[0], 2 * grid[1]
    defines = {**lights.defines, **read_defines(bound)}
    direct = DirectLight(device, lights, defines, ends, surfels.caster, on_gpu=True)
    trace = device.program("gather_trace.comp", defines=lights.defines)
    bumps = {"HAS_BUMPS": 1} if len(names) > 2 else {}
    resolve = device.program("gather_resolve.comp", defines={**lights.defines, **bumps})
    buffer = SurfelBuffer(device, surfels)
    albedo, emission = (device.ctx.texture(ends, 4, dtype="f4") for _ in range(2))
    position, normal = direct.points
    starts = device.ctx.texture(grid, 2, dtype="u4", data=np.uint32(spread_evenly(*grid) * 2.0**32).tobytes())
    unused = {name: device.ctx.texture(grid, 4, dtype="f4") for name in names if name not in bound.writes}

    def execute(frame: FrameState, resources: Resources) -> None:
        key = frame.view_and_lighting
        if not has_history and resources.is_current(key):
            return
        turns, samples = turns_of(frame, math.prod(grid), has_history)
        caster = surfels.caster
        common = {"ratio": ratio_to(grid, frame), "turns": turns, "turn": frame.index % turns,
                  "local_eye": tuple(frame.view.eye - caster.origin)}
        phase = np.random.default_rng(int(frame.noise_phase * 2**16)).integers(2**32, size=2).tolist()
        trace.set(phase=tuple(phase), ray_epsilon=float(caster.ray_epsilon), reach=float(surfels.world.median_radius),
                  **common)
        resolve.set(sample_count=len(samples), **common)
        rays.bind(trace)
        buffer.bind(resolve, resources.rows("surfel_indirect"))
        targets = [unused[name] if name in unused else resources[name] for name in names]
        for number, sample in enumerate(samples):
            trace.set(sample_index=sample)
            run_over_grid(device, trace, grid, TRACED_SIDE, {"surfaces": resources[surfaces], "starts": starts},
                          (position, normal, albedo, emission))
            light = direct.draw_estimate(frame, resources, sample)
            resolve.set(samples_before=number)
            run_over_grid(device, resolve, grid, 1, {
                "surfaces": resources[surfaces], "end_position": position, "end_normal": normal, "end_albedo": albedo,
                "end_emission": emission, **light}, targets)
        resources.set_current(key)

    return execute
