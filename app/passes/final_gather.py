"""Light that is gathered along rays from a low-resolution grid, few of them in a frame, and accumulated over frames.

Embree traces the rays on the CPU, or ``final_gather_gpu`` does on the GPU. Where they end, direct light is drawn as in
the picture, and indirect light is that of the world surfels around. Networks read the result, and clean it.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.arrays import F32, Ints
from app.gl.context import Device
from app.gl.direct_light import DirectLight
from app.gl.frame_state import Execute, FrameState, MotionKind
from app.gl.fullscreen import make_fullscreen, ratio_to, read_defines
from app.gl.lights import LightSet
from app.gl.pool import Resources
from app.graph import BoundPass, Buf, Pass, Resource, Tex
from app.math3d import put_rows, unit_rows
from app.passes import final_gather_gpu, surface_filter
from app.passes.gather_outliers import spread_outliers
from app.passes.gather_turns import is_turn, max_rays, turns_of
from app.surfels.final_gather import LightAt, gather, rotation_gradient, sequence
from app.surfels.tracked import TrackedSurfels

STILL_FRAMES = 4.0  # whose cleaned light is averaged at rest, since the first ones were cleaned from few rays
INTERPOLATED_FROM = 4  # surfels, where the light without rays matters little
LIT_AT_ONCE = 128, 128  # ends of rays that direct light is drawn at together, as a grid
MEANS = "gathered_light", "gathered_surfels"  # light and number of rays; surfels' light and distance of rays
GRADIENT = "gathered_gradient"  # of light by the tilt of bumps, see rotation_gradient


@dataclass(frozen=True, eq=False)
class Receivers:
    """The points that rays start from.

    Attributes
    ----------
    texel : ndarray of int, shape (N,)
        Texels of the grid that show a surface, bottom row first.
    position, normal, direction : ndarray, float32, shape (N, 3)
        Relative to the eye, in world axes; ``direction`` is that in which the eye sees the point.
    traced : ndarray of int, shape (M,)
        The points from which rays start in this frame. The others are there because they have no history.
    """

    texel: Ints
    position: F32
    normal: F32
    direction: F32
    traced: Ints


def declare(surfels: TrackedSurfels, lights: LightSet, grid: tuple[int, int], has_history: bool, on_gpu: bool,
            has_bumps: bool) -> Iterator[Pass]:
    """The passes over a ``grid`` of width and height.

    Parameters
    ----------
    has_history : bool
        Whether frames are accumulated.
    on_gpu : bool
        Whether the GPU traces the rays.
    has_bumps : bool
        Whether to find ``light_gradient`` too: how light changes as bumps tilt, over the light.
    """
    names = (*MEANS, GRADIENT) if has_bumps else MEANS
    means: dict[str, Resource] = {name: Tex("f4", 4, size=grid) for name in names}
    now = {f"{name}_now": tex for name, tex in means.items()} if has_history else means
    if on_gpu:
        yield final_gather_gpu.declare(surfels, lights, shown(has_history), now, grid, has_history)
    else:
        yield Pass("gather_rays", reads=("gather_surfaces", "surfel_indirect", *lights.shadow_maps), writes=now,
                   make=lambda device, bound: make(device, bound, surfels, lights, grid, has_history))
    if has_history:
        yield Pass("gather_history",
                   reads=(*now, "lowres_gbuffer", "motion", *(f"{name}@prev" for name in means), "lowres_gbuffer@prev"),
                   writes=means, make=make_fullscreen("gather_history.frag", lambda frame: {
                       **_history_uniforms(frame, grid), "max_rays": max_rays(frame, math.prod(grid))}))
    if has_bumps:
        near = GRADIENT + "_averaged"
        yield surface_filter.declare("gradient_filter_near", GRADIENT, near, grid, 1, divided=False)
        yield surface_filter.declare("gradient_filter_far", near, "light_gradient", grid, 3, divided=True)


def _history_uniforms(frame: FrameState, grid: tuple[int, int]) -> dict[str, object]:
    return {"ratio": ratio_to(grid, frame), "history_valid": frame.history_valid and not frame.relit}


def shown(has_history: bool) -> str:
    """The texture of what the grid shows: normals and depths, which are negative where history knows nothing."""
    return "gather_receivers" if has_history else "lowres_gbuffer"


def declare_receivers(grid: tuple[int, int]) -> Pass:
    """What the ``grid`` shows, and what of it history knows."""
    return Pass("gather_receivers", reads=("lowres_gbuffer", "motion", "gathered_light@prev", "lowres_gbuffer@prev"),
                writes={"gather_receivers": Tex("f4", 4, size=grid)},
                make=make_fullscreen("gather_receivers.frag", lambda frame: _history_uniforms(frame, grid)))


def declare_surfaces(grid: tuple[int, int], has_history: bool) -> Pass:
    """Bring what the ``grid`` shows to the CPU: a pass of its own, so that others can be drawn before its rays end."""
    shape, source = (grid[1], grid[0], 4), shown(has_history)
    return Pass("gather_surfaces", reads=(source,), writes={"gather_surfaces": Buf(shape, on_host=True)},
                make=lambda device, bound: lambda frame, resources: resources.write_array(
                    "gather_surfaces", np.frombuffer(resources[source].read(), np.float32).reshape(shape)))


def make(device: Device, bound: BoundPass, surfels: TrackedSurfels, lights: LightSet, grid: tuple[int, int],
         has_history: bool) -> Execute:
    suffix = "_now" if has_history else ""
    direct = DirectLight(device, lights, read_defines(bound), LIT_AT_ONCE, surfels.caster)

    def execute(frame: FrameState, resources: Resources) -> None:
        key = frame.view_and_lighting
        if not has_history and resources.is_current(key):
            return
        device.flush()  # what is waiting is drawn while the CPU traces rays
        turns, chosen = turns_of(frame, math.prod(grid), has_history)
        receivers = _receivers(resources.array("gather_surfaces"), frame, grid, turns)
        world, caster, lookup = surfels.world, surfels.caster, surfels.lookup
        indirect = resources.rows("surfel_indirect")
        has_sky = bool(world.sky_irradiance.any())

        def direct_at(at: F32, facing: F32) -> F32:
            light, _ = direct.estimate(frame, resources, at, facing)
            return light + lookup.approximate(world.sky_irradiance, at, facing) if has_sky else light

        light_at = LightAt(direct_at, lambda at, facing: lookup.approximate(indirect, at, facing))
        position = receivers.position + (frame.view.eye - world.origin).astype(np.float32)
        off = receivers.normal - receivers.direction  # the surface, towards the eye, where nothing is in the way
        origin = position + off * caster.ray_epsilon
        traced = receivers.traced
        numbers = sequence(grid, receivers.texel.take(traced), chosen.start, len(chosen), frame.noise_phase)
        interpolated = lookup.interpolate(indirect, position, receivers.normal, INTERPOLATED_FROM)
        facing = receivers.normal.take(traced, axis=0)
        rays = gather(caster, light_at, float(world.median_radius), origin.take(traced, axis=0), facing, numbers)
        light, distance = np.zeros((len(position), 4), np.float32), np.ones((len(position), 1), np.float32)
        mean = np.einsum("nkc->nc", rays.light) / np.float32(len(chosen))
        if frame.motion is not MotionKind.NONE or not frame.history_valid:
            mean = spread_outliers(mean, interpolated.take(traced, axis=0), len(chosen), receivers.texel.take(traced),
                                   receivers.position.take(traced, axis=0), facing, grid)
        put_rows(light[:, :3], traced, mean)
        light[traced, 3] = len(chosen)
        distance[traced, 0] = np.einsum("nk->n", rays.distance) / np.float32(len(chosen))
        found = {MEANS[0]: (light,), MEANS[1]: (interpolated, distance)}
        if GRADIENT + suffix in bound.writes:
            gradient = np.zeros((len(position), 4), np.float32)
            put_rows(gradient, traced, rotation_gradient(rays, facing))
            found[GRADIENT] = (gradient,)
        for name, columns in found.items():
            if name + suffix in bound.writes:
                texels = np.zeros((math.prod(grid), 4), np.float32)
                put_rows(texels, receivers.texel, np.concatenate(columns, axis=1))
                resources[name + suffix].write(texels.tobytes())
        resources.set_current(key)

    return execute


def _receivers(surfaces: F32, frame: FrameState, grid: tuple[int, int], turns: int) -> Receivers:
    """What those texels of ``gather_surfaces`` show whose turn it is, or which have no history."""
    surfaces = surfaces.reshape(-1, 4)
    has_turn = is_turn(grid, turns, frame.index % turns)
    texel = np.flatnonzero(np.isfinite(np.einsum("nc->n", surfaces)) & (
        (surfaces[:, 3] < 0) | has_turn & (surfaces[:, 3] > 0)))
    surface = surfaces.take(texel, axis=0)
    at = np.stack([texel % grid[0], texel // grid[0]], axis=1)
    pixel = np.floor((at + 0.5) * ratio_to(grid, frame)) + 0.5
    offset, direction = frame.view.rays(pixel / frame.size * 2 - 1 - frame.jitter)
    position = offset + direction * np.abs(surface[:, 3:])
    return Receivers(texel, position.astype(np.float32), surface[:, :3], unit_rows(direction).astype(np.float32),
                     np.flatnonzero(has_turn.take(texel)))
