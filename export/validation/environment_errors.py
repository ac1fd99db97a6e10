"""Compares models that shade an environment with the path-traced light that comes straight from it."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from app.arrays import F32, Bools
from app.evaluation import metrics
from app.evaluation.denoise import denoise, denoiser_version
from app.io.image import read_exr, write_exr
from app.network.selection import Model
from app.renderer import Renderer
from app.settings import Settings
from export.dataset.scene_key import scene_key
from export.dataset.scenes.environments import with_random_environment
from export.reference import environment_tracer
from export.reference.environment_tracer import EnvironmentTracer
from export.reference.path_tracer import average_samples
from export.reference.still import Still
from export.validation.errors import Progress, Row, find_configurations
from export.validation.views import View, views

OPEN_SCENES = ("sponza", "breakfast-room", "stanford", "cornell-box", "courtyard-2", "blocks-day-0")  # a sky is seen
VIEW_STEP = 2          # every second of their views
SIZE = (256, 192)
SEED = 2               # first number of every seed: neither the dataset's nor that of the validation list
MIN_LIT_SHARE = 0.2    # of the surfaces, which must receive ...
MIN_LIGHT = 0.01       # ... this share of the environment's mean radiance
SOURCES = sorted(Path(environment_tracer.__file__).parent.glob("*.py"))  # code that a reference depends on
METRICS = ("psnr", "ssim", "flip")
DENOISED = ("diffuse", "specular", "specular_with_fresnel")


@dataclass(frozen=True, eq=False)
class EnvironmentReference:
    """Light straight from the environment, sampled at pixel centres.

    Attributes
    ----------
    final : ndarray, float32, shape (H, W, 3)
        albedo × diffuse light + specular light with Fresnel's law, W/(sr m²).
    diffuse, specular : ndarray, float32, shape (H, W, 3)
        Demodulated; see ``EnvironmentSamples``.
    visible : ndarray of bool, shape (H, W)
        Where there is a surface.
    """

    final: F32
    diffuse: F32
    specular: F32
    visible: Bools


def environment_views(scenes: Path) -> list[View]:
    """Every second validation view of the open scenes, each with its own random environment."""
    chosen = []
    for number, view in enumerate(views(scenes, OPEN_SCENES)[::VIEW_STEP]):
        rng = np.random.default_rng([SEED, number])
        scene = with_random_environment(rng, view.still.scene)
        chosen.append(replace(view, still=replace(view.still, scene=scene, size=SIZE)))
    return chosen


def environment_reference(still: Still, spp: int, folder: Path) -> EnvironmentReference:
    """The path-traced and denoised reference, cached in ``folder``."""
    version = hashlib.sha256(b"".join(file.read_bytes() for file in SOURCES)).hexdigest()
    key = scene_key(still.scene, still.camera, still.size, still.time, spp, denoiser_version(), version)
    path = folder / f"{key}.exr"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_exr(path, _trace(still, spp))
    layers = read_exr(path)
    final = layers["albedo"] * layers["diffuse"] + layers["specular_with_fresnel"]
    return EnvironmentReference(final, layers["diffuse"], layers["specular"], layers["depth"][..., 0] > 0)


def is_lit(reference: EnvironmentReference, still: Still) -> bool:
    """Whether enough surfaces of the view receive light from the environment for its shading to be compared."""
    assert still.scene.environment is not None
    mean_radiance = float(still.scene.environment.radiance.mean())
    lit = reference.diffuse.max(axis=-1)[reference.visible] > MIN_LIGHT * mean_radiance
    return bool(reference.visible.any() and lit.mean() >= MIN_LIT_SHARE)


def measure_errors(chosen: Sequence[View], models: Sequence[str], spp: int, folder: Path,
                   progress: Progress) -> list[Row]:
    """Errors of the final picture on visible surfaces, one row per model and lit view.

    Raises
    ------
    AfterglowError
        When a model, the path tracer or the device is not available.
    """
    configurations = find_configurations(models, chosen[0].still.size)
    rows: list[Row] = []
    for number, view in enumerate(chosen):
        progress(f"{number + 1} of {len(chosen)}: {view.name}")
        reference = environment_reference(view.still, spp, folder)
        if not is_lit(reference, view.still):
            continue
        for configuration in configurations:
            picture = draw(view.still, configuration.models)
            errors = {name: metrics.METRICS[name].measure(picture, reference.final, reference.visible)
                      for name in METRICS}
            rows.append({"view": view.name, "scene": view.scene, "model": configuration.label, **errors})
    return rows


def draw(still: Still, models: Sequence[Model]) -> F32:
    """The renderer's light straight from the environment, one frame through pixel centres."""
    settings = Settings(still.size, ("direct", "specular"), taa=False, provider="cpu")
    with Renderer(still.scene, settings, models) as renderer:
        images = renderer.render(still.camera, still.time)
    return np.asarray(images["direct"] + images["specular"])


def _trace(still: Still, spp: int) -> dict[str, F32]:
    """Layers of a reference by name, those of ``DENOISED`` denoised."""
    w, h = still.size
    x, y = np.meshgrid((np.arange(w) + 0.5) / w, (np.arange(h) + 0.5) / h)
    centres = np.stack([x.ravel(), y.ravel()], axis=1)
    means = average_samples(EnvironmentTracer(still.scene, still.time).shade, still, centres, spp, 0)
    normal = means.normal.reshape(h, w, 3)
    layers: dict[str, F32] = {name: denoise(getattr(means, name).reshape(h, w, 3), normal) for name in DENOISED}
    return {**layers, "albedo": means.albedo.reshape(h, w, 3), "depth": means.depth.reshape(h, w, 1)}
