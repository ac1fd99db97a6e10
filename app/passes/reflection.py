"""Indirect light on glossy surfaces: rays marched over the screen or traced, gathered, filtered, upsampled.

While nothing moves, each frame has rays from other pixels, whose light is gathered at full resolution too.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache

import numpy as np

from app.gl.context import Device
from app.gl.frame_state import REFRESH_FRAMES, Execute, FrameState, MotionKind
from app.gl.fullscreen import always, make_fullscreen, ratio_to, reduced_grid
from app.graph import BoundPass, Pass, Resource, Tex
from app.math3d import R2, affine_matrix
from app.scene import Material

PIXELS_PER_TEXEL = 16  # of the grid, within these limits:
MIN_TEXELS, MAX_TEXELS = 2**16, 2**17
MAX_ROUGHNESS = 0.6  # from which surfaces need no rays, as in ray_share.glsl
MAX_SHARP_ROUGHNESS = 0.15  # from which image_sharpness in reflection.glsl is 0, but at wide angles
MARCH_STEPS = 16
RAY_EPSILON = 1e-4   # of the scene's longest edge, by which rays start off their surface
# Frames that are gathered, of mirrors and of rough surfaces.
MAX_FRAMES = {MotionKind.NONE: (256.0, 256.0), MotionKind.CAMERA: (8.0, 48.0), MotionKind.OBJECTS: (4.0, 16.0)}

Size = tuple[int, int]


def grid(size: Size) -> Size:
    """Width and height of the low-resolution grid for an output of the given width and height."""
    return reduced_grid(size, min(max(math.prod(size) // PIXELS_PER_TEXEL, MIN_TEXELS), MAX_TEXELS))


def needs_rays(material: Material) -> bool:
    """Whether a material is smooth enough somewhere for its reflections to be traced."""
    return material.min_roughness < MAX_ROUGHNESS


def declare_march(grid: Size, extent: float, has_history: bool, prefix: str = "") -> Pass:
    """Rays of the texels of ``grid``, and where the screen shows their ends.

    Parameters
    ----------
    extent : float
        The scene's longest edge in scene units.
    has_history : bool
        Whether frames are gathered. Then each has other rays; otherwise they are fixed per texel.
    prefix : str
        ``outer_`` for rays of outer surfaces (``outer_surface``) instead of those of the G-buffer.
    """
    texels = Tex("f4", 4, size=grid)
    surfaces = "reflection_gbuffer", "normal", "depth", "albedo", "specular_roughness"
    starts = tuple(prefix + name for name in surfaces) if prefix else ()
    return Pass(prefix + "reflection_march", reads=(*surfaces, *starts), optional=("peel0_depth",),
                writes={prefix + "reflection_origin": texels, prefix + "reflection_ray": texels,
                        prefix + "reflection_beam": Tex("f4", 2, size=grid),
                        prefix + "reflection_albedo": Tex("f4", 1, size=grid)},
                make=make_fullscreen("reflection_march.frag", lambda frame: {
                    "ratio": ratio_to(grid, frame), "noise_phase": frame.noise_phase, "steps": MARCH_STEPS,
                    "ray_epsilon": RAY_EPSILON * extent, "at_rest": _is_at_rest(frame) and has_history,
                    "noise_offset": tuple(step * frame.index % 1.0 for step in R2) if has_history else (0.0, 0.0),
                    **_start_uniforms(grid, frame, has_history)},
                    {"STARTS_AT_OUTER": 1} if prefix else {}, strip=prefix, samplers={name: name for name in starts},
                    fast_path=always))


def declare_gathering(grid: Size, has_history: bool, prefix: str = "") -> Iterator[Pass]:
    """The light at the rays' ends, gathered over frames if there is a history, and filtered."""
    light = Tex("f2", 4, size=grid)
    yield Pass(prefix + "reflection_resolve",
               reads=(*(prefix + name for name in ("reflection_origin", "reflection_ray", "reflection_beam",
                                                   "reflection_traced")),
                      "normal", "depth", "direct", "albedo", "indirect", "specular_roughness"),
               optional=("occlusion", "emission"), writes={prefix + "reflection_now": light},
               make=make_fullscreen("reflection_resolve.frag", strip=prefix, fast_path=always))
    history = ("reflection_origin", "reflection_ray", "reflection_chance", "reflection_gbuffer", "specular_roughness",
               "motion", "reflection_low@prev", "reflection_distance@prev", "reflection_gbuffer@prev")
    reads = "reflection_now", *(history if has_history else ())
    gathered: dict[str, Resource] = {prefix + "reflection_low": Tex("f4", 4, size=grid),
                                     prefix + "reflection_distance": Tex("f4", 1, size=grid)}
    yield Pass(prefix + "reflection_history", reads=tuple(prefix + name for name in reads), writes=gathered,
               make=make_fullscreen("reflection_history.frag", lambda frame: _history_uniforms(grid, frame)
                                    if has_history else {}, strip=prefix,
                                    fast_path=always if has_history else None))
    yield _filter("reflection_filter_far", "reflection_low", "reflection_averaged", grid, 3, prefix,
                  "reflection_origin")
    yield _filter("reflection_filter_near", "reflection_averaged", "reflection_filtered", grid, 1, prefix)


def has_detail(grid: Size, size: Size, has_history: bool) -> bool:
    """Whether reflections are gathered at full resolution too; an image as small as its ``grid`` does not need it."""
    return has_history and grid != size


def is_sharp(roughness: float) -> bool:
    """Whether what a surface reflects may be sharp."""
    return roughness < MAX_SHARP_ROUGHNESS


def declare_detail(grid: Size, follows_images: bool, prefix: str = "") -> Pass:
    """The light along the rays of single pixels, gathered while nothing moves, and of sharp images also in motion.

    Parameters
    ----------
    follows_images : bool
        Whether some images are sharp.
    """
    resting = make_fullscreen("reflection_detail.frag", lambda frame: {
        "ratio": ratio_to(grid, frame), "has_rested": frame.rests,
        "history_stands": frame.rests or (follows_images and _has_history(frame))}, strip=prefix)
    following = make_fullscreen("reflection_detail.frag", lambda frame: {
        **_image_uniforms(grid, frame), "history_stands": _has_history(frame),
        "bounded": frame.motion is MotionKind.OBJECTS}, {"FOLLOWS_IMAGES": 1}, strip=prefix, fast_path=always)

    def make(device: Device, bound: BoundPass) -> Execute:
        at_rest = resting(device, bound)
        moving = following(device, bound) if follows_images else lambda frame, resources: None
        return lambda frame, resources: (at_rest if _is_at_rest(frame) else moving)(frame, resources)

    reads = ("reflection_now", "reflection_origin", "reflection_albedo", "reflection_filtered",
             "reflection_detail@prev", "reflection_detail_albedo@prev")
    followed = ("reflection_distance", "reflection_distance@prev", "reflection_gbuffer@prev",
                "motion", "normal", "depth", "specular_roughness") if follows_images else ()
    return Pass(prefix + "reflection_detail", reads=tuple(prefix + r for r in (*reads, *followed)),
                writes={prefix + "reflection_detail": Tex("f2", 4), prefix + "reflection_detail_albedo": Tex("f2", 1)},
                make=make)


def surfaces_read(has_rays: bool, has_detail: bool, has_clearcoat: bool) -> tuple[str, ...]:
    """What ``reflected_light.glsl`` reads, beside indirect light; details only of what is traced."""
    return ("normal", "specular_roughness", *(("clearcoat",) if has_clearcoat else ()),
            *(("depth", "reflection_gbuffer", "reflection_filtered") if has_rays else ()),
            *(("reflection_detail", "reflection_detail_albedo", "reflection_distance")
              if has_rays and has_detail else ()))


def make_with_reflections(fragment: str, grid: Size, follows_images: bool, defines: Mapping[str, object] | None = None,
                          strip: str = "") -> Callable[[Device, BoundPass], Execute]:
    """``Pass.make`` of a full-screen pass with ``reflected_light.glsl``; with detail, at rest it has another shader.

    Parameters
    ----------
    follows_images : bool
        As of ``declare_detail``.
    """
    def draw(variant: dict[str, object]) -> Callable[[Device, BoundPass], Execute]:
        return make_fullscreen(fragment, lambda frame: {"ratio": ratio_to(grid, frame)}, {**(defines or {}), **variant},
                               strip)

    def make(device: Device, bound: BoundPass) -> Execute:
        has_detail = strip + "reflection_detail" in bound.reads
        moving = draw({"FOLLOWS_IMAGES": 1} if has_detail and follows_images else {})(device, bound)
        if not has_detail:
            return moving
        resting = draw({"AT_REST": 1})(device, bound)
        return lambda frame, resources: (resting if _is_at_rest(frame) else moving)(frame, resources)

    return make


def declare(grid: Size, surfaces: tuple[str, ...], follows_images: bool) -> Pass:
    """What is seen of reflections, at full resolution; of those of opaque surfaces, what ``composite`` adds by itself.

    Parameters
    ----------
    surfaces : tuple of str
        What ``surfaces_read`` gives.
    follows_images : bool
        As of ``declare_detail``.
    """
    return Pass("reflection", reads=("indirect", *surfaces), optional=("outer_reflection",),
                writes={"reflection": Tex("f2", 4)},
                make=make_with_reflections("reflection.frag", grid, follows_images))


def declare_outer(grid: Size, has_detail: bool, follows_images: bool, prefix: str) -> Pass:
    """The same of outer surfaces, which ``composite`` and ``peel0_blend`` add."""
    reads = "albedo", *surfaces_read(True, has_detail, has_clearcoat=False)
    return Pass(prefix + "reflection", reads=("indirect", *(prefix + name for name in reads)),
                writes={prefix + "reflection": Tex("f2", 4)},
                make=make_with_reflections("reflection.frag", grid, follows_images, {"OF_OUTER": 1}, prefix))


def _is_at_rest(frame: FrameState) -> bool:
    return frame.motion is MotionKind.NONE


def _has_history(frame: FrameState) -> bool:
    return frame.history_valid and not frame.relit


def _start_uniforms(grid: Size, frame: FrameState, has_history: bool) -> dict[str, object]:
    """Where in its texel each ray starts, in [0, 1), and how far from what its pixel shows, in pixels.

    As many frames as a texel has pixels cover all of them; each round begins with another one, so that a pixel does not
    always meet the same jitter. In motion and in the first round at rest, rays start in the middle of their pixels and,
    of sharp images, go along the middle of their lobe: few samples would make edges ragged.
    """
    if not has_history:
        return {"inside": (0.5, 0.5), "shift": (0.0, 0.0), "scatter": 1.0}
    sides = tuple(math.ceil(ratio) for ratio in ratio_to(grid, frame))
    cells = _spread_cells(*sides)
    at_rest = min(frame.index, frame.still - 1, frame.unchanged - REFRESH_FRAMES)  # frames for which nothing has moved
    number = at_rest if _is_at_rest(frame) else frame.index
    turn = number // len(cells)
    x, y = cells[(number + turn) % len(cells)]
    scatters = _is_at_rest(frame) and turn > 0
    to_middle = tuple(0.5 * side * offset for side, offset in zip(frame.size, frame.jitter, strict=True))
    return {"inside": ((x + 0.5) / sides[0], (y + 0.5) / sides[1]), "scatter": float(scatters),
            "shift": (0.0, 0.0) if scatters else to_middle}


@lru_cache(maxsize=4)
def _spread_cells(width: int, height: int) -> tuple[tuple[int, int], ...]:
    """The cells of a grid, ordered so that those of any few successive ones are spread over it."""
    cells = [(x, y) for y in range(height) for x in range(width)]
    return tuple(sorted(cells, key=lambda cell: (R2[0] * cell[0] + R2[1] * cell[1]) % 1.0))


def _filter(name: str, source: str, target: str, grid: Size, spacing: int, prefix: str, *reads: str) -> Pass:
    reads = (source, "reflection_distance", "reflection_gbuffer", "specular_roughness", *reads)
    return Pass(prefix + name, reads=tuple(prefix + r for r in reads),
                writes={prefix + target: Tex("f2", 4, size=grid)},
                make=make_fullscreen("reflection_filter.frag", lambda frame: {
                    "ratio": ratio_to(grid, frame), "spacing": spacing}, strip=prefix,
                                     samplers={prefix + source: "light_low"}, fast_path=always))


def _image_uniforms(grid: Size, frame: FrameState) -> dict[str, object]:
    """What mirror_image.glsl reads, and the grid's ratio."""
    previous = frame.previous
    moved = affine_matrix(np.eye(3), frame.view.eye - previous.eye)
    return {"ratio": ratio_to(grid, frame), "previous_from_relative": affine_matrix(previous.rotation) @ moved,
            "previous_lens": (*previous.half_size, *previous.center)}


def _history_uniforms(grid: Size, frame: FrameState) -> dict[str, object]:
    return {**_image_uniforms(grid, frame), "max_frames": MAX_FRAMES[frame.motion],
            "history_valid": _has_history(frame),
            "bounded": frame.motion is not MotionKind.NONE}
