"""The diffuse light that arrives at layers of what is seen through, from the environment and from other surfaces.

What arrives at the opaque surfaces that are seen there says little of it: a curtain before a window is lit by the room.
So it is interpolated between the world surfels, on a coarse grid, since it changes slowly along a surface.
"""

import math
from collections.abc import Sequence

import numpy as np

from app.arrays import F64
from app.gl.frame_state import Execute, FrameState
from app.gl.peeling import PeeledLayer
from app.gl.pool import Resources
from app.graph import Pass, Tex
from app.network.channels import HALF_MAX
from app.surfels.tracked import TrackedSurfels

MAX_TEXELS = 2**12  # of a layer's grid
MIN_SIDE = 4        # pixels along the edge of a texel


def declare(layers: Sequence[PeeledLayer], grid: tuple[int, int], surfels: TrackedSurfels) -> Pass:
    """Over a ``grid`` of width and height, ``arriving`` of each of ``layers``: irradiance / π; a: depth, 0 for none."""
    return Pass("layer_light", reads=("surfel_indirect", *(layer.prefix + "lowres_gbuffer" for layer in layers)),
                writes={layer.prefix + "arriving": Tex("f4", 4, size=grid) for layer in layers},
                make=lambda device, bound: _make(layers, grid, surfels))


def grid(size: tuple[int, int]) -> tuple[int, int]:
    """Width and height of the grid for an image of ``size``."""
    side = max(math.sqrt(math.prod(size) / MAX_TEXELS), MIN_SIDE)
    return math.ceil(size[0] / side), math.ceil(size[1] / side)


def _make(layers: Sequence[PeeledLayer], grid: tuple[int, int], surfels: TrackedSurfels) -> Execute:
    x, y = np.meshgrid(*((np.arange(n) + 0.5) / n * 2 - 1 for n in grid))
    centers: F64 = np.stack([x.ravel(), y.ravel()], axis=1)

    def execute(frame: FrameState, resources: Resources) -> None:
        visible = [layer for layer in layers if layer.is_visible]
        if not visible:
            return
        start, along = frame.view.rays(centers)
        start += frame.view.eye - surfels.world.origin
        sent = surfels.lookup.smooth(surfels.arriving_light(resources.rows("surfel_indirect")))
        for layer in visible:
            surface = np.frombuffer(resources[layer.prefix + "lowres_gbuffer"].read(), np.float32).reshape(-1, 4)
            rows = np.flatnonzero((surface[:, 3] > 0) & np.isfinite(surface).all(axis=1))
            light = np.zeros_like(surface)
            if len(rows):
                at = start[rows] + along[rows] * surface[rows, 3:]
                found = surfels.lookup.interpolate(sent, at.astype(np.float32), surface[rows, :3])
                light[rows] = np.concatenate([found.clip(0, HALF_MAX), surface[rows, 3:]], axis=1)
            resources[layer.prefix + "arriving"].write(light.tobytes())

    return execute
