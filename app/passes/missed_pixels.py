"""Light of their own for pixels whose surface the low-resolution grid misses: thin things, mouldings, silhouettes.

Each tile of the image has at most one such pixel in a frame. Its light is interpolated between the surfels, as the
network does for its grid. ``upsample`` takes it for the pixels around, and keeps it where a later frame finds another.
"""

import math
from collections.abc import Iterator

import numpy as np

from app.gl.compute import run_over_grid
from app.gl.context import Device
from app.gl.frame_state import Execute, FrameState, MotionKind
from app.gl.fullscreen import make_fullscreen, ratio_to
from app.gl.pool import Resources
from app.graph import BoundPass, Pass, Tex
from app.network.channels import HALF_MAX
from app.passes.surfel_buffer import SurfelBuffer
from app.surfels.tracked import TrackedSurfels

MIN_TILE = 8       # side in pixels
MAX_TILES = 2**14  # of an image
FRAME_TESTS = 4    # pixels of a tile that a frame with history tests


def tile_side(size: tuple[int, int]) -> int:
    """Side in pixels of the tiles, a power of 2, of an image of a width and height."""
    side = MIN_TILE
    while math.prod(_tiles(size, side)) > MAX_TILES:
        side *= 2
    return side


def declare(size: tuple[int, int], grid: tuple[int, int], surfels: TrackedSurfels, has_history: bool,
            normals: str) -> Iterator[Pass]:
    """In each tile of an image of ``size`` with a low-resolution ``grid``, widths and heights, at most one pixel.

    Parameters
    ----------
    has_history : bool
        Whether pixels keep light of earlier frames, so that not all of them have to be tested in each frame.
    normals : str
        Those of the image, as ``lowres_gbuffer`` has them.
    """
    side = tile_side(size)
    tiles = _tiles(size, side)

    def uniforms(frame: FrameState) -> dict[str, object]:
        follows = has_history and frame.history_valid and frame.motion is not MotionKind.OBJECTS
        first, tested = (frame.index * FRAME_TESTS % side**2, FRAME_TESTS) if follows else (0, side**2)
        return {"ratio": ratio_to(grid, frame), "first": first, "tested": tested}

    yield Pass("missed_pixels", reads=(normals, "depth", "lowres_gbuffer"),
               writes={name: Tex("f4", 4, size=tiles) for name in ("missed_position", "missed_surface")},
               make=make_fullscreen("missed_pixels.frag", uniforms, {"TILE": side}, samplers={normals: "normal"}))
    yield Pass("missed_light", reads=("missed_position", "missed_surface", "surfel_indirect"),
               writes={"missed_light": Tex("f4", 4, size=tiles)},
               make=lambda device, bound: (make_on_gpu(device, surfels, tiles) if surfels.caster.shader_rays
                                           else make(device, bound, surfels)))


def _tiles(size: tuple[int, int], side: int) -> tuple[int, int]:
    return -(-size[0] // side), -(-size[1] // side)


def make(device: Device, bound: BoundPass, surfels: TrackedSurfels) -> Execute:
    def execute(frame: FrameState, resources: Resources) -> None:
        position, surface = (np.frombuffer(resources[name].read(), np.float32).reshape(-1, 4)
                             for name in ("missed_position", "missed_surface"))
        rows = np.flatnonzero((position[:, 3] > 0) & np.isfinite(position).all(axis=1))
        light = np.zeros_like(position)
        if len(rows):
            indirect = resources.rows("surfel_indirect")
            at = position[rows, :3] + (frame.view.eye - surfels.world.origin).astype(np.float32)
            found, sees_any = surfels.lookup.interpolate_seen(indirect, at, surface[rows, :3], surfels.caster)
            number = position[rows, 3:] * sees_any[:, None]
            light[rows] = np.concatenate([np.nan_to_num(found).clip(0, HALF_MAX), number], axis=1)
        resources["missed_light"].write(light.tobytes())

    return execute


def make_on_gpu(device: Device, surfels: TrackedSurfels, tiles: tuple[int, int]) -> Execute:
    """The same without bringing pixels to the CPU."""
    program, buffer = device.program("missed_light.comp"), SurfelBuffer(device, surfels)

    def execute(frame: FrameState, resources: Resources) -> None:
        program.set(local_eye=tuple(frame.view.eye - surfels.world.origin))
        buffer.bind(program, resources.rows("surfel_indirect"))
        names = "missed_position", "missed_surface"
        run_over_grid(device, program, tiles, 1, {name: resources[name] for name in names}, [resources["missed_light"]])

    return execute
