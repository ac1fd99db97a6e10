"""Light that arrives at layers of what is seen through: diffuse light, and what others than the nearest layer mirror.

What arrives at the opaque surfaces that are seen there says little of it: a curtain before a window is lit by the room.
So it is interpolated between the world surfels, on a coarse grid, since it changes slowly along a surface. Rays from
there find other surfaces in the mirrored direction; the nearest layer has reflections of its own.
"""

import math
from collections.abc import Sequence

import numpy as np

from app.arrays import F32, F64
from app.gl.frame_state import Execute, FrameState
from app.gl.peeling import PeeledLayer
from app.gl.pool import Resources
from app.graph import Pass, Tex
from app.math3d import row_dots
from app.network.channels import HALF_MAX
from app.surfels.tracked import TrackedSurfels

MAX_TEXELS = 2**12  # of a layer's grid
MIN_SIDE = 4        # pixels along the edge of a texel


def declare(layers: Sequence[PeeledLayer], grid: tuple[int, int], surfels: TrackedSurfels) -> Pass:
    """Over a ``grid`` of width and height, for each of ``layers``.

    ``arriving`` is irradiance / π; a: depth, 0 for none. ``mirrored``, of all but the nearest, is the radiance that
    surfaces send to it from the mirrored direction; what analytic lights and the sky send is direct light.
    """
    names = [layer.prefix + "arriving" for layer in layers] + [layer.prefix + "mirrored" for layer in layers[1:]]
    return Pass("layer_light",
                reads=("surfel_light", "surfel_indirect", *(layer.prefix + "lowres_gbuffer" for layer in layers)),
                writes={name: Tex("f4", 4, size=grid) for name in names},
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
        indirect = resources.rows("surfel_indirect")
        sent = surfels.lookup.smooth(surfels.arriving_light(indirect))
        leaving = np.nan_to_num(resources.rows("surfel_light") + indirect, posinf=0).clip(0, HALF_MAX)
        for layer in visible:
            surface = np.frombuffer(resources[layer.prefix + "lowres_gbuffer"].read(), np.float32).reshape(-1, 4)
            rows = np.flatnonzero((surface[:, 3] > 0) & np.isfinite(surface).all(axis=1))
            normal = surface[rows, :3]
            at = (start[rows] + along[rows] * surface[rows, 3:]).astype(np.float32)
            found = {"arriving": surfels.lookup.interpolate(sent, at, normal)}
            if layer.index:
                found["mirrored"] = _mirrored(surfels, leaving, at, normal, along[rows].astype(np.float32))
            for name, light in found.items():
                texels = np.zeros_like(surface)
                texels[rows] = np.concatenate([light.clip(0, HALF_MAX), surface[rows, 3:]], axis=1)
                resources[layer.prefix + name].write(texels.tobytes())

    return execute


def _mirrored(surfels: TrackedSurfels, leaving: F32, at: F32, normal: F32, along: F32) -> F32:
    """Radiance from the mirrored direction at points that are seen ``along`` rays, in local space, shape (N, 3).

    ``leaving`` is the light of the surfels, irradiance / π.
    """
    caster = surfels.caster
    direction = along - 2 * row_dots(along, normal)[:, None] * normal
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    hits = caster.cast(at + normal * caster.ray_epsilon, direction)
    met = np.flatnonzero(hits.body >= 0)
    ends = hits.select(met)
    light = np.zeros_like(at)
    light[met] = ends.traced_emission + ends.albedo * surfels.lookup.interpolate(leaving, ends.position, ends.normal)
    return light
