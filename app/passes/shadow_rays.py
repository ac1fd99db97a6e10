"""Traced shadows of large lights and of the environment: how much of their light reaches the receivers of a grid.

Shadow rays are traced on a low-resolution grid, accumulated over frames, and filtered. The result is a ratio of light
with shadows to light without them, by which ``direct`` multiplies the exact unshadowed light (Heitz, Hill and McGuire
2018, "Combining Analytic Direct Illumination and Stochastic Shadows"). Where surfaces are shiny, some rays follow their
specular lobes to rectangles, and find which share of highlights is visible: a polished floor shows the bars before a
window, which are a blur in its diffuse light.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping

from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState, MotionKind
from app.gl.fullscreen import CUBE_PREFIX, cube_defines, make_fullscreen, ratio_to, read_defines, reduced_grid
from app.gl.light_guide import LightGuide
from app.gl.lights import LightSet
from app.gl.pool import Resources
from app.gl.ray_budget import RayBudget
from app.gl.receiver_tiles import FIRST_SAMPLES, tiles
from app.gl.shadow_rays import RayScene, ShadowRays, merge_unguided, share_of, specular_defines
from app.gl.shadow_rays_gpu import MAX_LESSONS, GpuShadowRays
from app.gl.sky_guide import SkyGuide
from app.graph import BoundPass, Pass, Resource, Tex

MAX_RECEIVERS = 2**17  # of the screen's grid
RAYS = RayBudget(first_rays=2**22, max_first_samples=64, changed_rays=2**19, rays=2**17, max_samples=8)
CUBE_SAMPLES = 16      # of a receiver on the cube, which has no history
MAX_SAMPLES = {MotionKind.NONE: 1024.0, MotionKind.CAMERA: 64.0, MotionKind.OBJECTS: 12.0}  # of its history
# The same of specular rays; mirror images slide over surfaces while the camera moves.
MAX_SPECULAR_SAMPLES = {MotionKind.NONE: 512.0, MotionKind.CAMERA: 8.0, MotionKind.OBJECTS: 6.0}
SKY_READS = ("sky_irradiance", "sky_strata")
SUMS, SPECULAR, AVERAGED = ("shadow_visible", "shadow_unshadowed"), "shadow_specular", "_averaged"
SKY = "sky_visible"         # visible share of the sky's light in tiles, where shadow_ratio is also that of lights
# Of a tile's history, which does not follow what moves.
MAX_TILE_SAMPLES = {MotionKind.NONE: 1024.0, MotionKind.CAMERA: 8.0, MotionKind.OBJECTS: 2.0}


def grid(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height of the screen's grid."""
    return reduced_grid(size, MAX_RECEIVERS)


def declare(lights: LightSet, has_specular: bool, has_sky: bool, scene: Callable[[], RayScene], size: tuple[int, int],
            has_history: bool) -> Iterator[Pass]:
    """The passes on the screen, for its ``shadow_gbuffer``.

    Parameters
    ----------
    has_specular, has_sky : bool
        Whether some material has a specular lobe; whether the environment's shadows are traced too.
    scene : callable
        Gives what the rays can meet.
    has_history : bool
        Whether samples are accumulated over frames.
    """
    receivers = grid(size)
    defines = specular_defines(lights.defines, has_specular)
    sums: dict[str, Resource] = {name: Tex("f4", 4, size=receivers) for name in SUMS}
    if defines:
        sums[SPECULAR] = Tex("f4", 4, size=receivers)
    now = {f"{name}_now": tex for name, tex in sums.items()} if has_history else dict(sums)
    of_sky = {SKY: Tex("f4", 1, size=tiles(receivers))} if has_sky and lights.has_traced and has_specular else {}
    surfaces = "albedo", "normal", "depth", *(("specular_roughness",) if defines else ())
    yield Pass("shadow_rays", reads=(*surfaces, *(SKY_READS if has_sky else ())), writes={**now, **of_sky},
               make=lambda device, bound: _make_rays(device, bound, lights, defines, scene(), receivers, has_history))
    if has_history:
        yield Pass("shadow_history",
                   reads=(*now, "shadow_gbuffer", "motion", *(f"{name}@prev" for name in sums), "shadow_gbuffer@prev"),
                   writes=sums, make=make_fullscreen("shadow_history.frag", lambda frame: {
                       "ratio": ratio_to(receivers, frame), "max_samples": MAX_SAMPLES[frame.motion],
                       **({"max_specular_samples": MAX_SPECULAR_SAMPLES[frame.motion]} if defines else {}),
                       "history_valid": frame.history_valid and not frame.relit},
                       samplers={"shadow_gbuffer": "lowres_gbuffer", "shadow_gbuffer@prev": "lowres_gbuffer_prev"}))
    averaged = {name + AVERAGED: tex for name, tex in sums.items()}
    yield _filter("shadow_filter_near", sums, averaged, defines, receivers, 1)
    yield _filter("shadow_filter_far", averaged, {"shadow_ratio": Tex("f2", 4, size=receivers)}, defines, receivers, 3)


def _filter(name: str, source: Collection[str], target: Mapping[str, Resource], defines: Mapping[str, object],
            size: tuple[int, int], spacing: int) -> Pass:
    samplers = {name: name.removesuffix(AVERAGED) for name in source}
    return Pass(name, reads=(*source, "shadow_gbuffer"), writes=target,
                make=make_fullscreen("shadow_filter.frag", lambda frame: {
                    "ratio": ratio_to(size, frame), "spacing": spacing, "shift": filter_shift(frame, spacing)}, defines,
                    samplers={**samplers, "shadow_gbuffer": "lowres_gbuffer"}))


def filter_shift(frame: FrameState, spacing: int) -> tuple[int, int]:
    """Texels by which a filter of that spacing is shifted, so that frames at rest fill the gaps between its texels.

    Others would flicker: temporal anti-aliasing averages few of them.
    """
    if not frame.accumulates or frame.motion is not MotionKind.NONE:
        return 0, 0
    y, x = divmod(4 * (frame.index + 1) % spacing**2, spacing)  # each once in spacing² frames, if that is odd
    return x - spacing // 2, y - spacing // 2


def _make_rays(device: Device, bound: BoundPass, lights: LightSet, defines: Mapping[str, object], scene: RayScene,
               size: tuple[int, int], has_history: bool) -> Execute:
    has_sky, traced = "sky_strata" in bound.reads, len(lights.lights) - len(lights.mapped)
    sky_guide = SkyGuide(device, size) if has_sky else None
    has_choice = traced > 0 and traced + has_sky > 1 and scene.shader_rays is None
    light_guide = LightGuide(device, size, len(lights.lights)) if has_choice else None
    defines = {**lights.defines, **defines, **read_defines(bound)}
    rays = ShadowRays(device, size, defines, scene, sky_guide, light_guide)
    draws_rays = scene.shader_rays is not None and (sky_guide is None or has_history)
    gpu_rays = GpuShadowRays(device, size, defines, scene, sky_guide) if draws_rays else None
    sums = [name for name in bound.writes if name != SKY]
    last_frame = -1

    def execute(frame: FrameState, resources: Resources) -> None:
        nonlocal last_frame
        key = frame.view_and_lighting
        if not has_history and resources.is_current(key):
            return
        resources.bind(rays.program)
        rays.program.set(ratio=ratio_to(size, frame))
        if gpu_rays is not None:
            gpu_rays.learn()
        samples = RAYS.samples(frame, math.prod(size), has_history)
        # Frames of another render scale may have come between.
        continues = has_history and frame.history_valid and frame.index == last_frame + 1
        last_frame = frame.index
        if sky_guide is not None:
            _follow(sky_guide, frame, continues)
            if continues:
                sky_guide.keep(MAX_TILE_SAMPLES[frame.motion])
        if light_guide is not None:
            _follow(light_guide, frame, continues and not frame.relit)
        before = None
        if not continues and (sky_guide is not None or light_guide is not None):
            before = rays.trace(frame, range(FIRST_SAMPLES))
            samples = range(max(samples.start, FIRST_SAMPLES), samples.stop)
        if gpu_rays is not None and (sky_guide is None or len(samples) <= MAX_LESSONS):
            resources.bind(gpu_rays.program)
            gpu_rays.program.set(ratio=ratio_to(size, frame))
            gpu_rays.draw(frame, samples, [resources[name] for name in sums])
        else:
            found = rays.trace(frame, samples)
            if before is not None and not (has_history and frame.history_valid):
                found = merge_unguided(found, before, rays.guided)
            for name, values in zip(sums, found, strict=True):
                resources[name].write(values.tobytes())
        if sky_guide is not None and SKY in bound.writes:
            resources[SKY].write(sky_guide.visible_share.tobytes())
        resources.set_current(key)

    return execute


def _follow(guide: SkyGuide | LightGuide, frame: FrameState, continues: bool) -> None:
    """Let a guide forget all if the frame does not continue the last one, or trust it less if something moves."""
    if not continues:
        guide.forget()
    elif frame.motion is not MotionKind.NONE:
        guide.fade()


def declare_cube(lights: LightSet, has_sky: bool, scene: Callable[[], RayScene], face: int, camera_axes: bool) -> Pass:
    """On the cube around the camera, without a filter, since networks average over its texels."""
    size = 6 * face, face
    return Pass("cube_shadow_rays", reads=("cube_albedo", "cube_normal", "cube_depth", *(SKY_READS if has_sky else ())),
                writes={"cube_shadow_ratio": Tex("f4", 4, size=size)},
                make=lambda device, bound: _make_cube_rays(
                    device, bound, scene(), size, {**lights.defines, **cube_defines(face, camera_axes)}))


def _make_cube_rays(device: Device, bound: BoundPass, scene: RayScene, size: tuple[int, int],
                    defines: Mapping[str, object]) -> Execute:
    rays = ShadowRays(device, size, {**defines, **read_defines(bound)}, scene)

    def execute(frame: FrameState, resources: Resources) -> None:
        key = frame.view_and_lighting
        if resources.is_current(key):
            return
        resources.bind(rays.program, CUBE_PREFIX)
        rays.program.set(ratio=(1.0, 1.0))
        visible, unshadowed = rays.trace(frame, range(CUBE_SAMPLES))
        resources["cube_shadow_ratio"].write(share_of(visible, unshadowed).tobytes())
        resources.set_current(key)

    return execute
