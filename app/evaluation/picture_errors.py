"""Errors: a configuration's layers against the reference's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from app.evaluation import metrics
from app.evaluation.configurations import Configuration
from app.evaluation.reference import Reference
from app.renderer import Renderer
from app.scene import Camera, Scene
from app.settings import Settings

F32 = NDArray[np.float32]
Layers = dict[str, F32]
Errors = dict[str, float]

AMBIENT = "ambient (oracle)"
UNDER_SKY = ("under an environment the final picture alone is judged: the reference counts light straight from there as "
             "indirect, models do as they are chosen")
SETTLE = 16          # frames until temporal anti-aliasing has settled, as for a still
METRICS: dict[str, Callable[..., float]] = {
    "flip": metrics.flip, "psnr": metrics.psnr, "ssim": metrics.ssim, "rel_mse": metrics.rel_mse}
HIGHER_IS_BETTER = ("psnr", "ssim")
BRIGHTEST_AMBIENT = 16.0  # of the reference's mean indirect light


def draw_layers(scene: Scene, camera: Camera, configuration: Configuration, provider: str) -> Layers:
    """What is judged.

    Returns
    -------
    dict of str to ndarray, float32, shape (H, W, 3)
        ``final`` settled by temporal anti-aliasing, as the reference's is averaged over each pixel; where there is no
        environment also ``direct`` and ``indirect`` of one frame through pixel centres, as the reference has them.
    """
    settings = Settings(size=configuration.size, outputs=("final",), provider=provider)
    with Renderer(scene, settings, configuration.models) as renderer:
        for _ in range(SETTLE - 1):
            renderer.advance(camera)
        layers = {"final": renderer.render(camera)["final"]}
    if scene.environment is not None:  # reference and models part its light into direct and indirect in ways of their own
        return layers
    centres = replace(settings, outputs=("direct", "indirect"), taa=False)
    with Renderer(scene, centres, configuration.models) as renderer:
        return {**renderer.render(camera), **layers}


def errors_of(layers: Layers, reference: Reference) -> dict[str, Errors]:
    """All metrics of the layers that are there; ``indirect`` only where the reference's albedo is not black."""
    masks = {"direct": None, "indirect": reference.demodulated, "final": None}
    return {name: {metric: f(layers[name], reference.layers[name], mask) for metric, f in METRICS.items()}
            for name, mask in masks.items() if name in layers and (mask is None or mask.any())}


def draw_ambient(scene: Scene, camera: Camera, reference: Reference, provider: str) -> tuple[Layers, list[float]]:
    """The picture with the best constant indirect light, and that constant.

    Its parts are averages over jittered frames, so that its edges are as smooth as the others'.
    """
    settings = Settings(reference.size, ("final", "albedo", "direct", "emission", "specular", "background"),
                        provider=provider)
    with Renderer(scene, settings) as renderer:
        frames = [renderer.render(camera) for _ in range(SETTLE)]
    albedo, *added = (np.mean([f[name] for f in frames], axis=0) for name in settings.outputs[1:])
    base = np.sum(added, axis=0)
    constant = best_ambient(base, albedo, reference.layers["final"])
    layers = {"final": base + albedo * constant}
    if scene.environment is None:
        layers["indirect"] = np.where(reference.layers["depth"] > 0, constant, 0).astype(np.float32)
    return layers, constant.tolist()


def best_ambient(base: F32, albedo: F32, final: F32) -> F32:
    """The colour c, shape (3,), for which base + albedo · c, tone-mapped, is nearest to ``final`` in squared error.

    In place of ``albedo`` any picture will do, such as that of light whose strength is sought.
    """
    exposure = metrics.exposure_of(final)
    shown = metrics.tone_map(final, exposure).astype(np.float64)

    def error(constants: NDArray[np.float64], channel: int) -> list[float]:
        return [float(((metrics.tone_map(base[..., channel] + albedo[..., channel] * c, exposure)
                        - shown[..., channel]) ** 2).mean()) for c in constants]

    best = []
    for channel in range(3):
        colour, reached = float(final[..., channel].mean()), float(albedo[..., channel].mean())
        low, high, nearest = 0.0, BRIGHTEST_AMBIENT * colour / reached if reached > 0 else 0.0, 0.0
        for _ in range(6):  # each grid is eight times finer than the one before
            grid = np.linspace(low, high, 17)
            index = int(np.argmin(error(grid, channel)))
            low, nearest, high = grid[max(index - 1, 0)], grid[index], grid[min(index + 1, 16)]
        best.append(nearest)
    return np.array(best, np.float32)
