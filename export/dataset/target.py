"""What a network is to find for a frame: the light of the texels that the renderer picks for its half grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.evaluation.denoise import denoise
from export.dataset import nearest_texels
from export.reference.environment_tracer import EnvironmentTracer, mean_shaded
from export.reference.path_tracer import PathTracer
from export.reference.still import RAYS_AT_ONCE, Still

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

LIGHT_LAYERS = ("diffuse", "specular")
SKY_LAYERS = (*LIGHT_LAYERS, "albedo", "reflectance")
SKY_VERSION = "sky 3"  # the same of what comes from an environment
VERSION = 1  # raise it when targets change, so that those of before are made again


@dataclass(frozen=True, eq=False)
class Target:
    """Light on a grid of half the image's size, its top row first.

    Attributes
    ----------
    layers : mapping of str to ndarray, float32, shape (H, W, 3)
        ``indirect`` and ``indirect_single``: radiance / albedo in W/(sr m²) by all bounces, and by one. Or, of what
        comes straight from an environment, ``diffuse``, ``specular``, ``albedo`` and ``reflectance``; see
        ``export.reference.environment_tracer.EnvironmentSamples``. 0 in the sky.
    seen : ndarray of bool, shape (H, W)
        False: sky.
    """

    layers: Mapping[str, F32]
    seen: NDArray[np.bool_]


def trace_target(tracer: PathTracer, still: Still, spp: int, seed: int, denoised: bool) -> Target:
    """Trace ``spp`` paths through each picked texel.

    Parameters
    ----------
    denoised : bool
        Whether Open Image Denoise takes noise out, guided by the normals; the albedo is 1, as the light is demodulated.

    Raises
    ------
    MissingExtraError
        When there is nothing to denoise with.
    """
    grid = picked(still.size)
    height, width = grid.shape[:2]
    points = grid.reshape(-1, 2)
    at_once = max(1, RAYS_AT_ONCE // len(points))
    multi = single = np.zeros((len(points), 3))
    for batch, begin in enumerate(range(0, spp, at_once)):
        count = min(at_once, spp - begin)
        samples = tracer.trace(still.view, np.tile(points, (count, 1)), seed * 2**8 + batch)
        multi, single = (total + found.reshape(count, -1, 3).sum(axis=0, dtype=np.float64)
                         for total, found in ((multi, samples.multi), (single, samples.single)))
    seen = samples.depth[:len(points)] > 0
    normal = samples.normal[:len(points)].reshape(height, width, 3)
    indirect, indirect_single = ((total / spp).reshape(height, width, 3).astype(np.float32)
                                 for total in (multi, single))
    if denoised:
        indirect, indirect_single = denoise(indirect, normal), denoise(indirect_single, normal)
    return Target({"indirect": indirect, "indirect_single": indirect_single}, seen.reshape(height, width))


def trace_sky(tracer: EnvironmentTracer, still: Still, spp: int, seed: int, denoised: bool) -> Target:
    """What comes straight from the environment, from ``spp`` samples through each picked texel."""
    grid = picked(still.size)
    means = mean_shaded(tracer, still, grid.reshape(-1, 2), spp, seed)
    layers = {name: getattr(means, name).reshape(*grid.shape[:2], 3) for name in SKY_LAYERS}
    for name in LIGHT_LAYERS if denoised else ():
        layers[name] = denoise(layers[name], means.normal.reshape(*grid.shape[:2], 3))
    return Target(layers, (means.depth > 0).reshape(grid.shape[:2]))


def picked(size: tuple[int, int]) -> F64:
    """Image positions in [0, 1] of the texels that stand for the half grid, as ``shaders/include/nearest_texel.glsl`` picks.

    Returns
    -------
    ndarray, float64, shape (H, W, 2)
        x to the right, y down.
    """
    y, x = nearest_texels.picked(size, (size[0] // 2, size[1] // 2))
    return np.stack(np.meshgrid((x + 0.5) / size[0], (y + 0.5) / size[1]), axis=-1)
