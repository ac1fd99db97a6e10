"""The part of a reference that the diffuse path tracer leaves out: emission, specular light and background."""

import numpy as np

from app.arrays import F32
from app.renderer import Renderer
from app.settings import Settings
from export.reference.environment_tracer import EnvironmentTracer
from export.reference.path_tracer import MAX_RAYS, average_samples
from export.reference.still import Still

SUPERSAMPLING = 4     # sample positions along a pixel's edge
ENVIRONMENT_SPP = 16  # samples of the environment's specular light at each of these positions
RENDERED = ("emission", "specular", "background")


def render_non_diffuse(still: Still, seed: int) -> F32:
    """All radiance that reaches the camera besides diffuse light, float32 [H, W, 3], averaged over each pixel.

    The renderer draws emission, specular light of the lights and background, supersampled.
    """
    scene, (w, h), n = still.scene, still.size, SUPERSAMPLING
    settings = Settings((n * w, n * h), RENDERED, taa=False, provider="cpu")
    with Renderer(scene, settings) as renderer:
        images = renderer.render(still.camera, still.time)
    total = np.sum([images[name] for name in RENDERED], axis=0)
    radiance = total.reshape(h, n, w, n, 3).mean(axis=(1, 3), dtype=np.float64).astype(np.float32)
    if scene.environment is not None and any(material.has_specular for material in scene.materials):
        radiance = radiance + trace_environment_specular(still, seed)
    return radiance


def trace_environment_specular(still: Still, seed: int = 0) -> F32:
    """Specular light of the environment with the Fresnel factor, float32 [H, W, 3], averaged over each pixel."""
    (w, h), n = still.size, SUPERSAMPLING
    tracer, random = EnvironmentTracer(still.scene, still.time), np.random.default_rng(seed)
    x, y = (np.arange(n * w) + 0.5) / (n * w), (np.arange(n * h) + 0.5) / (n * h)
    rows = max(1, MAX_RAYS // (ENVIRONMENT_SPP * n * n * w))  # of pixels in a strip
    strips = []
    for top in range(0, h, rows):
        points = np.stack(np.meshgrid(x, y[n * top:n * (top + rows)]), axis=-1).reshape(-1, 2)
        samples = average_samples(tracer.shade, still, points, ENVIRONMENT_SPP, int(random.integers(2**24)))
        strip = samples.specular_with_fresnel.reshape(-1, n, w, n, 3)
        strips.append(strip.mean(axis=(1, 3), dtype=np.float64))
    return np.concatenate(strips).astype(np.float32)
