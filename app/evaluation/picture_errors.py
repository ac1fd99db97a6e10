"""Errors of a configuration's layers against those of the reference."""

from dataclasses import replace

import numpy as np

from app.arrays import F32, F64
from app.evaluation import metrics
from app.evaluation.configurations import Configuration
from app.evaluation.reference import Reference
from app.renderer import Renderer
from app.scene import Camera, Scene
from app.settings import SETTLE_FRAMES, Settings

Layers = dict[str, F32]
Errors = dict[str, float]

AMBIENT = "ambient (oracle)"
MAX_AMBIENT_RATIO = 16.0  # of the ambient light to the reference's mean radiance / albedo
SEARCH_ROUNDS, SEARCH_STEPS = 6, 16


def draw_layers(scene: Scene, camera: Camera, configuration: Configuration, provider: str) -> Layers:
    """Draw what is compared with the reference.

    Returns
    -------
    dict of str to ndarray, float32, shape (H, W, 3)
        ``final`` with converged temporal anti-aliasing, as the reference's is averaged over each pixel; ``direct`` and
        ``indirect`` of one frame through pixel centres, as in the reference; of frames of the image's size only.
    """
    settings = configuration.settings(provider)
    with Renderer(scene, settings, configuration.models) as renderer:
        for _ in range(settings.settle_frames - 1):
            renderer.advance(camera)
        layers = {"final": renderer.render(camera)["final"]}
    if settings.render_scale < 1:
        return layers
    centred = replace(settings, outputs=("direct", "indirect"), taa=False)
    with Renderer(scene, centred, configuration.models) as renderer:
        return {**renderer.render(camera), **layers}


def errors_of(layers: Layers, reference: Reference) -> dict[str, Errors]:
    """All metrics by layer; ``indirect`` only where the reference's albedo is not black."""
    masks = {"direct": None, "indirect": reference.demodulated, "final": None}
    return {name: {key: metric.measure(layers[name], reference.layers[name], mask)
                   for key, metric in metrics.METRICS.items()}
            for name, mask in masks.items() if name in layers and (mask is None or mask.any())}


def draw_ambient(scene: Scene, camera: Camera, reference: Reference, provider: str) -> tuple[Layers, list[float]]:
    """The picture with the best constant indirect light, and that constant.

    It is averaged over jittered frames, so that its edges are as smooth as those of the other pictures.
    """
    settings = Settings(reference.size, ("final", "albedo", "direct", "emission", "specular", "background"),
                        provider=provider)
    with Renderer(scene, settings) as renderer:
        frames = [renderer.render(camera) for _ in range(SETTLE_FRAMES)]
    albedo, *added = (np.mean([f[name] for f in frames], axis=0) for name in settings.outputs[1:])
    base = np.sum(added, axis=0)
    constant = best_ambient(base, albedo, reference.layers["final"])
    indirect = np.where(reference.layers["depth"] > 0, constant, 0).astype(np.float32)
    return {"final": base + albedo * constant, "indirect": indirect}, constant.tolist()


def best_ambient(base: F32, albedo: F32, final: F32) -> F32:
    """The colour c, shape (3,), for which base + albedo · c, tone-mapped, has the least squared error to ``final``.

    ``albedo`` may be any other picture too, such as light whose best factor is sought.
    """
    exposure = metrics.exposure_of(final)
    target = metrics.tone_map(final, exposure).astype(np.float64)

    def errors(constants: F64, channel: int) -> list[float]:
        return [float(((metrics.tone_map(base[..., channel] + albedo[..., channel] * c, exposure)
                        - target[..., channel]) ** 2).mean()) for c in constants]

    best = []
    for channel in range(3):
        mean_final, mean_albedo = float(final[..., channel].mean()), float(albedo[..., channel].mean())
        low, middle = 0.0, 0.0
        high = MAX_AMBIENT_RATIO * mean_final / mean_albedo if mean_albedo > 0 else 0.0
        for _ in range(SEARCH_ROUNDS):  # each grid is eight times finer than the previous one
            grid = np.linspace(low, high, SEARCH_STEPS + 1)
            index = int(np.argmin(errors(grid, channel)))
            low, middle, high = grid[max(index - 1, 0)], grid[index], grid[min(index + 1, SEARCH_STEPS)]
        best.append(middle)
    return np.array(best, np.float32)
