"""Judges models on the validation views: errors of the final picture and of the demodulated indirect light."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.errors import SettingsError
from app.evaluation.configurations import Configuration, expand
from app.evaluation.denoise import denoiser_version
from app.evaluation.picture_errors import (
    AMBIENT,
    METRICS,
    Errors,
    Layers,
    best_ambient,
    draw_ambient,
    draw_layers,
    errors_of,
)
from app.evaluation.reference import Reference, cache_folder, exporter_version, kept_reference, renderer_version
from app.renderer import Renderer
from app.settings import Settings
from export.dataset.key import scene_key
from export.reference.path_tracer import MAX_BOUNCES
from export.reference.still import Still
from export.reference.trace import write_reference
from export.validation.views import View

F32 = NDArray[np.float32]

LAYERS = ("final", "indirect")
ORACLE = "× oracle"    # a model's light times the best constant of each colour and view
ALL = "mean"          # of all views, in place of a scene's name

Progress = Callable[[str], object]


@dataclass(frozen=True)
class Row:
    """One model on one view; ``errors`` by layer and metric."""

    model: str
    view: str
    scene: str
    errors: dict[str, Errors]


def reference_of(view: View, spp: int, folder: Path | None) -> Reference:
    """The path-traced and denoised reference, from ``folder`` (or the benchmark's cache) where it was made before."""
    still = view.still
    key = scene_key(still.scene, still.camera, still.size, still.time, spp, denoiser_version(),
                    exporter_version(still.scene), renderer_version(still.scene))
    return kept_reference((folder or cache_folder()) / f"{view.name}-{key}", lambda fresh: write_reference(
        fresh, still, spp, 0, MAX_BOUNCES, {"view": view.name}, lambda share: None, denoised=True))


def judge(views: Sequence[View], models: Sequence[str], spp: int, references: Path | None, provider: str,
          progress: Progress, oracle: bool = False) -> list[Row]:
    """Errors of every model on every view, and of the oracle ambient light.

    Parameters
    ----------
    models : sequence of str
        Texts for ``app.evaluation.configurations.find_models``.
    oracle : bool
        Whether each model is judged as well with its light as strong as suits the reference best, colour by colour in each
        view: what is wrong then is not how much light there is.

    Raises
    ------
    AfterglowError
        When a model, the path tracer or the device can't be had.
    """
    configurations, absent = expand(models, [view.still.size for view in views[:1]])
    if absent:
        raise SettingsError("; ".join(absent), "models", "expected models that exist")
    rows = []
    for number, view in enumerate(views):
        progress(f"{number + 1} of {len(views)}: {view.name}")
        reference = reference_of(view, spp, references)
        rows += [Row(label, view.name, view.scene, errors_of({name: layers[name] for name in LAYERS}, reference))
                 for label, layers in _pictures(view.still, reference, configurations, provider, oracle)]
    return rows


def by_scene(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Mean errors of each model on each scene, and on all views (scene ``mean``): as flat as CSV."""
    models, scenes = dict.fromkeys(row.model for row in rows), dict.fromkeys(row.scene for row in rows)
    return [_mean(model, scene, [row for row in rows if row.model == model and scene in (row.scene, ALL)])
            for scene in (*scenes, ALL) for model in models]


def by_view(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Each row as flat as CSV."""
    return [{"model": row.model, "scene": row.scene, "view": row.view, **_flat(row.errors)} for row in rows]


def to_json(rows: Sequence[Row], about: dict[str, Any]) -> str:
    return json.dumps({**about, "scenes": by_scene(rows), "views": by_view(rows)}, indent=1) + "\n"


def _pictures(still: Still, reference: Reference, configurations: Sequence[Configuration],
              provider: str, oracle: bool) -> Iterator[tuple[str, Layers]]:
    albedo = _albedo(still) if oracle else np.float32(0)
    for c in configurations:
        layers = draw_layers(still.scene, still.camera, c, provider)
        light = albedo * layers["indirect"]
        yield c.label, layers
        if oracle and layers["indirect"].any():
            best = best_ambient(layers["final"] - light, light, reference.layers["final"])
            yield f"{c.label} {ORACLE}", _scaled(layers, light, best)
    yield AMBIENT, draw_ambient(still.scene, still.camera, reference, provider)[0]


def _albedo(still: Still) -> F32:
    """What indirect light is multiplied by in the picture."""
    with Renderer(still.scene, Settings(still.size, ("albedo",), taa=False)) as renderer:
        return renderer.render(still.camera, still.time)["albedo"]


def _scaled(layers: Layers, reflected: F32, factor: F32) -> Layers:
    """The layers with ``factor`` times the indirect light, of which the final picture has ``reflected``."""
    return {"final": np.maximum(layers["final"] + (factor - 1) * reflected, 0), "indirect": layers["indirect"] * factor}


def _mean(model: str, scene: str, rows: Sequence[Row]) -> dict[str, Any]:
    flat = [_flat(row.errors) for row in rows]
    return {"model": model, "scene": scene, "views": len(rows),
            **{key: float(np.mean([f[key] for f in flat])) for key in flat[0]}}


def _flat(errors: dict[str, Errors]) -> dict[str, float]:
    return {f"{layer}.{metric}": errors[layer][metric] for layer in LAYERS for metric in METRICS}
