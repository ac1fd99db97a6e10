"""The path-traced light that a network is to predict for a frame."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.arrays import F32, F64, Bools
from app.evaluation.denoise import denoise
from export.reference.environment_tracer import EnvironmentTracer
from export.reference.path_tracer import PathTracer, average_samples
from export.reference.still import Still

# Raise these when targets change, so that existing ones are made again.
VERSION = 3
ENVIRONMENT_VERSION = "sky 5"  # part of the keys of pairs under environments
# Layers of targets, and the names of these samples.
INDIRECT_LAYERS = {"indirect": "multi", "indirect_single": "single"}
ENVIRONMENT_LAYERS = {name: name for name in ("diffuse", "specular", "albedo", "reflectance")}
LIGHT_LAYERS = {*INDIRECT_LAYERS, "diffuse", "specular"}


@dataclass(frozen=True, eq=False)
class Target:
    """Light on a grid of half the image's size, top row first.

    Attributes
    ----------
    layers : mapping of str to ndarray, float32, shape (H, W, 3)
        ``indirect`` and ``indirect_single``: radiance / albedo in W/(sr m²) by all bounces, and by one. For unbounced
        light of an environment instead ``diffuse``, ``specular``, ``albedo`` and ``reflectance``, see
        ``export.reference.environment_tracer.EnvironmentSamples``. 0 where there is no surface.
    seen : ndarray, bool, shape (H, W)
        Whether the texel shows a surface.
    """

    layers: Mapping[str, F32]
    seen: Bools


def trace_target(tracer: PathTracer, still: Still, spp: int, seed: int, denoised: bool) -> Target:
    """Indirect light, or by an ``EnvironmentTracer`` unbounced light, from ``spp`` paths per texel of the half grid.

    Parameters
    ----------
    denoised : bool
        Denoise with the normals as guides. The light is demodulated, so it needs no albedo.

    Raises
    ------
    MissingExtraError
        When the denoiser is missing.
    """
    trace, layers = ((tracer.shade, ENVIRONMENT_LAYERS) if isinstance(tracer, EnvironmentTracer)
                     else (tracer.trace, INDIRECT_LAYERS))
    grid = texel_positions(still.size)
    means = average_samples(trace, still, grid.reshape(-1, 2), spp, seed)
    images = {name: getattr(means, sample).reshape(*grid.shape[:2], 3) for name, sample in layers.items()}
    for name in LIGHT_LAYERS & layers.keys() if denoised else ():
        images[name] = denoise(images[name], means.normal.reshape(images[name].shape))
    return Target(images, (means.depth > 0).reshape(grid.shape[:2]))


def texel_positions(size: tuple[int, int]) -> F64:
    """Image positions, in [0, 1], of the texels that represent the half grid.

    Returns
    -------
    ndarray, float64, shape (H, W, 2)
        x to the right, y down.
    """
    y, x = nearest_texels(size, (size[0] // 2, size[1] // 2))
    return np.stack(np.meshgrid((x + 0.5) / size[0], (y + 0.5) / size[1]), axis=-1)


def nearest_texels(size: tuple[int, int], grid: tuple[int, int]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the image's texels that represent the grid's, as in shaders/include/nearest_texel.glsl."""
    (w, h), (columns, rows) = size, grid
    x = np.floor((np.arange(columns) + 0.5) * (w / columns))
    y = h - 1 - np.floor((np.arange(rows)[::-1] + 0.5) * (h / rows))  # the shader's rows begin at the bottom
    return y.astype(np.intp), x.astype(np.intp)
