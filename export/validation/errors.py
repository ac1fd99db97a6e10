"""Errors of models on the validation views: of the final picture, of demodulated indirect light, of direct light."""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from app.arrays import F32
from app.evaluation.configurations import Configuration, expand
from app.evaluation.denoise import denoiser_version
from app.evaluation.metrics import METRICS, exposure_of, tone_map
from app.evaluation.picture_errors import AMBIENT, Layers, best_ambient, draw_ambient, draw_layers, errors_of
from app.evaluation.reference import Reference, cache_folder, cache_reference
from app.evaluation.versions import exporter_version
from app.renderer import Renderer
from app.settings import Settings
from export.dataset.scene_key import scene_key
from export.reference.path_tracer import MAX_BOUNCES
from export.reference.still import Still
from export.reference.trace import write_reference
from export.validation.views import View

WHERE = "MODEL"      # the argument that names models
LAYERS = ("final", "indirect")
DIRECT = "direct.psnr"  # of light straight from lights, at the edges of shadows too
ERRORS = (*(f"{layer}.{metric}" for layer in LAYERS for metric in METRICS), DIRECT)  # keys of a row
NOISE = {layer: f"reference_noise.{layer}" for layer in ("final", "direct", "indirect")}  # keys of a row
ORACLE = "× oracle"  # suffix of a model whose light is scaled by the best constant per colour channel and view
ALL = "mean"         # in place of a scene's name: the mean over all views

Progress = Callable[[str], object]
# One model on one view: ``model``, ``scene``, ``view``, errors by ``layer.metric``, and the relative standard error of
# each layer of the reference before it was denoised. Figures are None where there is none to average.
Row = dict[str, Any]


def find_configurations(models: Sequence[str], size: tuple[int, int]) -> list[Configuration]:
    """One configuration for each text; see ``app.network.selection.find_models``.

    Raises
    ------
    AfterglowError
        When a model does not exist or is named twice.
    """
    return expand(models, [size], where=WHERE)[0]


def reference_of(view: View, spp: int, folder: Path | None) -> Reference:
    """The path-traced and denoised reference, cached in ``folder`` or in the benchmark's cache."""
    still = view.still
    key = scene_key(still.scene, still.camera, still.size, still.time, spp, denoiser_version(),
                    exporter_version(still.scene))
    return cache_reference((folder or cache_folder()) / f"{view.name}-{key}", lambda temporary: write_reference(
        temporary, still, spp, 0, MAX_BOUNCES, {"view": view.name}, lambda share: None, denoised=True,
        emission_is_direct=False))


def measure_errors(views: Sequence[View], models: Sequence[str], spp: int, references: Path | None, provider: str,
                   progress: Progress, oracle: bool = False) -> list[Row]:
    """Errors of every model on every view, and of the oracle ambient light.

    Parameters
    ----------
    models : sequence of str
        Texts for ``app.network.selection.find_models``.
    oracle : bool
        Also evaluate each model with its indirect light scaled by the constant, per colour channel and view, that fits
        the reference best. The error that remains is not one of brightness.

    Raises
    ------
    AfterglowError
        When a model, the path tracer or the device is not available.
    """
    rows: list[Row] = []
    for number, view in enumerate(views):
        progress(f"{number + 1} of {len(views)}: {view.name}")
        reference = reference_of(view, spp, references)
        noise = {key: reference.about.get("noise", {}).get(layer) for layer, key in NOISE.items()}
        configurations = find_configurations(models, view.still.size)
        for label, layers in _pictures(view.still, reference, configurations, provider, oracle):
            errors = errors_of({name: layers[name] for name in LAYERS}, reference)
            flat: Row = {f"{layer}.{metric}": errors[layer][metric] for layer in LAYERS for metric in METRICS}
            flat[DIRECT] = _direct_psnr(layers["direct"], reference)
            rows.append({"model": label, "scene": view.scene, "view": view.name, **flat, **noise})
    return rows


def by_scene(rows: Sequence[Row], metrics: Sequence[str] = ERRORS) -> list[Row]:
    """Means of ``metrics`` for each model over the ``views`` of each scene, and over all (scene ``mean``).

    A mean is over the views that have the figure, None if none has.
    """
    models, scenes = dict.fromkeys(row["model"] for row in rows), dict.fromkeys(row["scene"] for row in rows)
    means = []
    for scene, model in product((*scenes, ALL), models):
        if chosen := [row for row in rows if row["model"] == model and scene in (row["scene"], ALL)]:
            means.append({"model": model, "scene": scene, "views": len(chosen),
                          **{name: _mean([row[name] for row in chosen]) for name in metrics}})
    return means


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _direct_psnr(direct: F32, reference: Reference) -> float | None:
    """PSNR of direct light, shape (H, W, 3), in dB, with the exposure of the whole picture; None if it is exact.

    An exposure of its own would magnify the faint direct light of rooms that are lit indirectly.
    """
    exposure = exposure_of(reference.layers["final"])
    squares = (tone_map(direct, exposure) - tone_map(reference.layers["direct"], exposure)) ** 2
    return -10 * math.log10(squares.mean(dtype=np.float64)) if squares.any() else None


def _pictures(still: Still, reference: Reference, configurations: Sequence[Configuration],
              provider: str, oracle: bool) -> Iterator[tuple[str, Layers]]:
    albedo = _albedo(still) if oracle else np.float32(0)
    for c in configurations:
        layers = draw_layers(still.scene, still.camera, c, provider)
        direct = layers["direct"]
        reflected = albedo * layers["indirect"]
        yield c.label, layers
        if oracle and layers["indirect"].any():
            factor = best_ambient(layers["final"] - reflected, reflected, reference.layers["final"])
            yield f"{c.label} {ORACLE}", _scale_indirect(layers, reflected, factor)
    yield AMBIENT, {**draw_ambient(still.scene, still.camera, reference, provider)[0], "direct": direct}


def _albedo(still: Still) -> F32:
    """The albedo that the renderer multiplies indirect light by."""
    with Renderer(still.scene, Settings(still.size, ("albedo",), taa=False)) as renderer:
        return renderer.render(still.camera, still.time)["albedo"]


def _scale_indirect(layers: Layers, reflected: F32, factor: F32) -> Layers:
    """The layers with indirect light scaled by ``factor``; ``reflected`` is its part of the final picture."""
    final = np.maximum(layers["final"] + (factor - 1) * reflected, 0)
    return {**layers, "final": final, "indirect": layers["indirect"] * factor}
