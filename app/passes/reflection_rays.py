"""What reflected rays meet where the screen does not show it, or not all of it: lit surfaces, or the environment.

Direct light at the rays' ends is drawn as in the picture; indirect light is that of the world surfels around.
"""

import math
from collections.abc import Callable

import numpy as np

from app.arrays import F32, Bools, Ints
from app.environment import SKY_DISTANCE, radiance_along
from app.gl.compute import run_over_grid
from app.gl.context import Device
from app.gl.direct_light import DirectLight, PointLobes
from app.gl.environment_texture import environment_texture
from app.gl.frame_state import Execute, FrameState, MotionKind
from app.gl.fullscreen import ratio_to, read_defines
from app.gl.lights import LightSet
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex
from app.math3d import GOLDEN_RATIO, R2, put_rows, row_dots
from app.passes.surfel_buffer import SurfelBuffer
from app.raycast.caster import Caster, Hits, concatenate, width_at
from app.raycast.onward_rays import go_on, of_highlights, sharpness
from app.scene import Environment
from app.surfels.tracked import TrackedSurfels

FIRST_RAYS = 2**17    # of a frame without history: all of them
FRAME_RAYS = {MotionKind.NONE: 2**15, MotionKind.CAMERA: 2**12, MotionKind.OBJECTS: 2**13}  # of other frames
MIN_SHARP_RAYS = 2**13  # of a frame, of sharp images, which no neighbours replace
SHADOW_RAYS_AT_REST = 4  # at their ends, since mirrors are shown pixel by pixel then, and nothing averages their noise
LIT_AT_ONCE = 64, 64   # ends of rays that direct light is drawn at together, as a grid
NOT_SHOWN = -1.0      # for the length of a ray, as in reflection.glsl, where those of sharp images have less
# Shares of the length of a ray whose end the screen shows, between which it must be free, as in reflection_trace.comp:
# facets beside its ends are not where their smooth normals say.
FREE_FROM, FREE_TO = 0.02, 0.98
MAX_UNIT_ERROR = 0.1  # of a direction's squared length
# Ends of rays whose light is averaged:
MAX_APART = 0.1       # of a ray's length, their distance
MAX_TEXELS_APART = 2.0  # or of a texel's width there, where a curved mirror shows much in few texels
MAX_SLOPE = 0.1       # of the line between them over the surface at one of them
SAME_NORMAL = 0.95    # cosine of the angle between their normals
MIN_OTHERS = 4        # around, by whose mean the light of one is limited
MAX_OVER_OTHERS = 4.0  # times that mean and that of all ends: rare light beside emitters would be dots
ONWARD_STEPS = GOLDEN_RATIO, math.sqrt(2)  # of a frame's random numbers in shaders, other ones than of the first rays
TRACED_SIDE = 8       # texels along the edges of what a work group of reflection_trace.comp traces


def declare(grid: tuple[int, int], surfels: TrackedSurfels, lights: LightSet, environment: Environment | None,
            has_history: bool, prefix: str = "") -> Pass:
    """Over a low-resolution ``grid`` of width and height.

    Parameters
    ----------
    has_history : bool
        Whether frames are gathered, so that each traces only some of the rays.
    prefix : str
        As of ``reflection.declare_march``.
    """
    # The pass that writes ``surfel_light`` moves the surfels.
    rays = tuple(prefix + name for name in ("reflection_origin", "reflection_ray", "reflection_beam"))
    return Pass(prefix + "reflection_rays", reads=(*rays, "surfel_light", *lights.shadow_maps),
                optional=("surfel_indirect",), writes={prefix + "reflection_traced": Tex("f4", 4, size=grid),
                                                     prefix + "reflection_chance": Tex("f4", 1, size=(1, 1))},
                make=lambda device, bound: (
                    _make_on_gpu(device, bound, grid, surfels, lights, environment, has_history, prefix)
                    if surfels.caster.shader_rays else
                    _make(device, bound, grid, surfels, lights, environment, has_history, prefix)))


def _make(device: Device, bound: BoundPass, grid: tuple[int, int], surfels: TrackedSurfels, lights: LightSet,
          environment: Environment | None, has_history: bool, prefix: str) -> Execute:
    dither = _dither(grid)
    has_lobes = bool(lights.mapped)
    direct = DirectLight(device, lights, read_defines(bound), LIT_AT_ONCE, surfels.caster, has_lobes=has_lobes)

    def execute(frame: FrameState, resources: Resources) -> None:
        ray = _read(resources, prefix + "reflection_ray")
        continues = has_history and frame.history_valid
        budget = FRAME_RAYS[frame.motion] if continues else FIRST_RAYS
        shadow_rays = SHADOW_RAYS_AT_REST if continues and frame.motion is MotionKind.NONE else 1
        rows, chance = _choose(ray, (dither + GOLDEN_RATIO * frame.index) % 1.0, budget)
        _write_chance(bound, resources, prefix, chance)
        origin = _read(resources, prefix + "reflection_origin")[:, :3]
        shift = (frame.view.eye - surfels.caster.origin).astype(np.float32)
        rows = np.concatenate([rows, _hidden(surfels.caster, origin, shift, ray)])
        traced = np.zeros_like(ray)
        if len(rows):
            lookup = surfels.lookup
            of_surfels = lookup.smooth(_light_of(surfels, bound, resources))

            def light_at(hits: Hits, along: F32, covers: Bools, ends: Ints) -> tuple[F32, F32, F32]:
                light, highlights = direct.estimate(frame, resources, hits.position, hits.normal, shadow_rays,
                                                    lambda traced: _averaged(traced, rows.take(ends), grid, hits,
                                                                             texel_beams.take(ends, axis=0)),
                                                    _lobes(surfels.caster, hits, along, covers) if has_lobes else None)
                return light, highlights, lookup.interpolate(of_surfels, hits.position, hits.normal)

            beams = _read(resources, prefix + "reflection_beam").take(rows, axis=0)
            texel_beams = max(ratio_to(grid, frame)) * beams
            seeds = frame.index if has_history else 0, int(2**32 * frame.noise_phase)
            u = np.random.default_rng(seeds).random((len(rows), 2), np.float32)
            put_rows(traced, rows, _trace(surfels.caster, light_at, environment, origin.take(rows, axis=0) + shift,
                                          ray.take(rows, axis=0)[:, :3], beams, u))
        resources[prefix + "reflection_traced"].write(traced.tobytes())

    return execute


def _make_on_gpu(device: Device, bound: BoundPass, grid: tuple[int, int], surfels: TrackedSurfels, lights: LightSet,
                 environment: Environment | None, has_history: bool, prefix: str) -> Execute:
    """The same with rays that shaders trace, all of them in each frame."""
    rays = surfels.caster.shader_rays
    assert rays is not None
    ends_grid = grid[0], 2 * grid[1]  # those of the rays, and above them those of rays that go on
    direct = DirectLight(device, lights, read_defines(bound), ends_grid, surfels.caster, on_gpu=True, has_lobes=True)
    trace = device.program("reflection_trace.comp", defines={"HAS_ENVIRONMENT": 1} if environment else {})
    light = device.program("reflection_light.comp", defines=lights.defines)
    sky = {} if environment is None else {"environment": environment_texture(device, environment)}
    rotation = 0.0 if environment is None else environment.rotation_deg / 360 % 1.0
    buffer = SurfelBuffer(device, surfels)
    ends = dict(zip(("end_position", "end_normal", "end_albedo", "end_emission"),
                    (*direct.points, *(device.ctx.texture(ends_grid, 4, dtype="f4") for _ in range(2))), strict=True))

    def execute(frame: FrameState, resources: Resources) -> None:
        caster = surfels.caster
        _write_chance(bound, resources, prefix, 1.0)
        trace.set(local_eye=tuple(frame.view.eye - caster.origin), sky_distance=SKY_DISTANCE * caster.extent,
                  rotation=rotation, ray_epsilon=caster.ray_epsilon, noise_phase=frame.noise_phase,
                  noise_offset=tuple(step * (1 + frame.index * has_history) % 1.0 for step in ONWARD_STEPS))
        rays.bind(trace)
        traced = {**{name: resources[prefix + name] for name in ("reflection_origin", "reflection_ray")}, **sky}
        run_over_grid(device, trace, grid, TRACED_SIDE, traced, (*ends.values(), *direct.lobes))
        drawn = direct.draw_estimate(frame, resources, frame.index)
        buffer.bind(light, surfels.lookup.smooth(_light_of(surfels, bound, resources)), with_sky=False)
        run_over_grid(device, light, grid, 1, {**ends, **drawn}, [resources[prefix + "reflection_traced"]])

    return execute


def _light_of(surfels: TrackedSurfels, bound: BoundPass, resources: Resources) -> F32:
    """Light that arrives at the surfels, but for that of lights, shape (S, 3)."""
    return surfels.arriving_light(resources.rows("surfel_indirect") if "surfel_indirect" in bound.reads
                                  else surfels.world.emissive_irradiance)


def _read(resources: Resources, name: str) -> F32:
    """A texture's texels, shape (N, components), bottom row first."""
    texture = resources[name]
    return np.frombuffer(texture.read(), np.float32).reshape(-1, texture.components)


def _write_chance(bound: BoundPass, resources: Resources, prefix: str, chance: float) -> None:
    """Of rays whose end the screen does not show, to be traced; for a history, if there is one."""
    if (name := prefix + "reflection_chance") in bound.writes:
        resources[name].write(np.float32(chance).tobytes())


def _choose(ray: F32, threshold: F32, budget: int) -> tuple[Ints, float]:
    """Some of the rays whose end the screen does not show, spread evenly, others in each frame.

    At most about ``budget`` of those of blurred images; also the chance that each of these had.
    """
    rows = np.flatnonzero(ray[:, 3] < 0)
    is_sharp = ray[:, 3].take(rows) < NOT_SHOWN
    sharp = int(is_sharp.sum())
    chance_of_sharp = min(max(budget, MIN_SHARP_RAYS) / max(sharp, 1), 1.0)
    chance = min(budget / max(len(rows) - sharp, 1), 1.0)
    rows = rows[threshold.take(rows) < np.where(is_sharp, chance_of_sharp, chance)]
    return rows[_has_direction(ray, rows)], chance


def _hidden(caster: Caster, origin: F32, shift: F32, ray: F32) -> Ints:
    """Rays whose end the screen shows although something is seen before it, which their march has stepped over.

    Parameters
    ----------
    origin : ndarray, float32, shape (N, 3)
        In relative space.
    shift : ndarray, float32, shape (3,)
        From there to local space.
    """
    rows = np.flatnonzero((ray[:, 3] > 0) & np.isfinite(ray[:, 3]))
    rows = rows[_has_direction(ray, rows) & np.isfinite(origin.take(rows, axis=0)).all(axis=1)]
    if not len(rows):
        return rows
    start, along = origin.take(rows, axis=0) + shift, ray.take(rows, axis=0)
    met = caster.cast_through(start + FREE_FROM * along[:, 3:] * along[:, :3], along[:, :3])
    hides = met.hits.distance < (FREE_TO - FREE_FROM) * along[met.ray, 3]
    return rows[np.unique(met.ray[hides])]


def _has_direction(ray: F32, rows: Ints) -> Bools:
    """Which of some rays have a direction of unit length."""
    with np.errstate(invalid="ignore", over="ignore"):
        direction = ray.take(rows, axis=0)[:, :3]
        return np.asarray(np.abs(row_dots(direction, direction) - 1) < MAX_UNIT_ERROR)


def _averaged(light: F32, rows: Ints, grid: tuple[int, int], hits: Hits, beams: F32) -> F32:
    """The mean of light at each ray's end and at those of the texels around, if they are near and on a flat surface.

    Few shadow rays say little of many lights. What is reflected stays sharp, but for traced shadows.

    Parameters
    ----------
    light : ndarray, float32, shape (M, 3)
        At ``hits``; those that are not the end of a ray keep theirs.
    rows : ndarray, int64, shape (N,)
        Texels of a ``grid`` of width and height that the rays start from whose ends are the first hits.
    beams : ndarray, float32, shape (N, 2)
        Of the whole texels, as ``Caster.cast_through`` has them.
    """
    ends = len(rows)
    position, normal, distance = hits.position[:ends], hits.normal[:ends], hits.distance[:ends]
    reach = np.maximum(MAX_APART * distance, MAX_TEXELS_APART * width_at(beams, distance))
    index = np.full((grid[1] + 2, grid[0] + 2), -1, np.int64)
    y, x = np.divmod(rows, grid[0])
    index[y + 1, x + 1] = np.arange(ends)
    around, count = np.zeros_like(light[:ends]), np.zeros((ends, 1), np.float32)
    finite = np.where(np.isfinite(light), light, 0)
    neighbours: list[tuple[Ints, Bools]] = []
    for up, right in ((0, 1), (1, 0), (1, 1), (1, -1), (0, -1), (-1, 0), (-1, -1), (-1, 1)):
        other = index[y + 1 + up, x + 1 + right]
        away = position.take(other, axis=0) - position
        height, span = row_dots(away, normal), row_dots(away, away)
        alike = ((other >= 0) & (span < reach * reach) & (height * height <= MAX_SLOPE**2 * span)
                 & (row_dots(normal.take(other, axis=0), normal) > SAME_NORMAL))[:, None]
        neighbours.append((other, alike))
        around += np.where(alike, finite.take(other, axis=0), 0)
        count += alike
    usual = around / np.maximum(count, 1) + finite.mean(axis=0, dtype=np.float64).astype(np.float32)
    limited = light.copy()
    limited[:ends] = np.where(count >= MIN_OTHERS, np.minimum(light[:ends], MAX_OVER_OTHERS * usual), light[:ends])
    total = limited.copy()
    for other, alike in neighbours:
        total[:ends] += np.where(alike, limited.take(other, axis=0), 0)
    total[:ends] /= 1 + count
    return total


def _lobes(caster: Caster, hits: Hits, along: F32, covers: Bools) -> PointLobes:
    """The lobes of what rays meet, where it covers all; highlights on sharp ones are what onward rays meet."""
    lobes = caster.lobes(hits, 1.0)
    return PointLobes(lobes.f0, -along, lobes.roughness, (1 - sharpness(lobes.roughness)) * covers[:, None])


def _trace(caster: Caster, light_at: Callable[[Hits, F32, Bools, Ints], tuple[F32, F32, F32]],
           environment: Environment | None, origin: F32, direction: F32, beams: F32, u: F32) -> F32:
    """Radiance along rays and their lengths, to what is most seen, shape (N, 4).

    Lengths are negative where rays pass something or go on, so that what the screen shows at their end is not all.

    Parameters
    ----------
    light_at : callable
        Takes what is met, directions of the rays that met it, whether it covers what is behind, and which of the rays
        end at the first of it; gives direct irradiance / π there, highlights and indirect irradiance / π.
    beams : ndarray, float32, shape (N, 2)
        As ``Caster.cast_through`` has them.
    u : ndarray, float32, shape (N, 2)
        In [0, 1), that choose where rays go on.
    """
    finite: Bools = np.asarray(np.isfinite(origin).all(axis=1))
    count = len(origin)
    met = caster.cast_through(np.where(finite[:, None], origin, 0), direction, beams)
    ends = np.flatnonzero(finite & (met.hits.body[:count] >= 0))
    onward = go_on(caster, met.hits.select(ends), *(values.take(ends, axis=0) for values in (direction, beams, u)))
    goes_on = ends.take(onward.end)
    hits = concatenate([met.hits, onward.hits])
    for_direct = hits.albedo.copy()
    hits.albedo[goes_on], for_direct[goes_on] = onward.left, onward.left_for_direct
    passed = np.arange(count, len(met.ray))
    for_highlights = of_highlights(caster, met.hits.select(passed)) / np.maximum(met.covering[passed], 1e-6)
    for_direct[passed] = np.maximum(for_direct[passed] - for_highlights, 0)
    emission = np.concatenate([met.hits.traced_emission, onward.hits.emission])
    ray, along = np.concatenate([met.ray, goes_on]), np.concatenate([direction.take(met.ray, axis=0), onward.direction])
    share = np.concatenate([met.share, met.share.take(goes_on, axis=0) * onward.share])
    is_sky, counts = hits.body < 0, finite.take(ray)
    found = np.zeros((count, 4), np.float32)
    if len(lit := np.flatnonzero(counts & ~is_sky)):
        at = hits.select(lit)
        covers = (lit < count) | (lit >= len(met.ray))
        direct, highlights, indirect = light_at(at, along.take(lit, axis=0), covers, ray[lit[lit < count]])
        light = emission.take(lit, axis=0) + for_direct.take(lit, axis=0) * direct + highlights + at.albedo * indirect
        np.add.at(found[:, :3], ray[lit], share[lit] * light)
    if environment is not None and len(sky := np.flatnonzero(counts & is_sky)):
        np.add.at(found[:, :3], ray[sky], share[sky] * radiance_along(environment, along[sky].astype(np.float64)))
    distance = np.where(is_sky, SKY_DISTANCE * caster.extent, hits.distance)
    distance[len(met.ray):] += distance[goes_on]
    seen = met.share.sum(axis=1)
    mirrored = onward.share.sum(axis=1) / np.maximum((onward.share + onward.left).sum(axis=1), 1e-6)
    seen = np.concatenate([seen, seen[goes_on] * mirrored])
    seen[goes_on] *= 1 - mirrored
    order = np.argsort(seen, kind="stable")  # the last one of a ray is the one most seen
    found[ray[order], 3] = distance[order]
    found[ray[count:], 3] *= -1
    found[~finite, 3] = 0
    return found


def _dither(grid: tuple[int, int]) -> F32:
    """Thresholds in [0, 1) of a grid's texels, shape (N,), bottom row first: Roberts' R2 sequence as a lattice."""
    x, y = np.meshgrid(np.arange(grid[0]), np.arange(grid[1]))
    return np.asarray((R2[0] * x + R2[1] * y) % 1.0, np.float32).ravel()
