"""Models of one scene beside each other and the reference: one HTML page that needs no other file."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from app.bench.report import COLUMNS, LAYERS, fill_page, html_table
from app.bench.rows import number
from app.evaluation.configurations import Configuration
from app.evaluation.embedded_images import shown
from app.evaluation.picture_errors import METRICS, UNDER_SKY, Errors, draw_layers, errors_of
from app.evaluation.reference import Reference
from app.scene import Camera, Scene

F32 = NDArray[np.float32]
REFERENCE = "reference"


def side_by_side(scene: Scene, camera: Camera, configurations: Sequence[Configuration], reference: Reference | None,
                 provider: str, progress: Callable[[str], None] = lambda _: None) -> str:
    """Draw, judge, and lay out.

    Parameters
    ----------
    configurations : sequence of Configuration
        Without a reference, at least two: the last one is what the others are compared with.
    """
    pictures: dict[str, F32] = {}
    errors: dict[str, Mapping[str, Errors]] = {}
    for configuration in configurations:
        progress(configuration.label)
        layers = draw_layers(scene, camera, configuration, provider)
        pictures[configuration.label] = layers["final"]
        errors[configuration.label] = errors_of(layers, reference) if reference is not None else {}
    if reference is not None:
        pictures[REFERENCE] = reference.layers["final"]
    compared_to = list(pictures)[-1]
    if reference is None:
        errors = {label: {"final": {name: metric(picture, pictures[compared_to]) for name, metric in METRICS.items()}}
                  for label, picture in pictures.items() if label != compared_to}
    return _page(scene, pictures, compared_to, errors, reference)


def _page(scene: Scene, pictures: dict[str, F32], compared_to: str, errors: Mapping[str, Mapping[str, Errors]],
          reference: Reference | None) -> str:
    images = shown(pictures, compared_to)
    height, width = pictures[compared_to].shape[:2]
    about = [f"{width}×{height}, {scene.triangles} triangles", *([scene.lighting] if scene.lighting else [])]
    if reference is not None:
        about += [f"reference of {reference.about['spp']} samples per pixel"] if "spp" in reference.about else []
        about += reference.about.get("notices", [])
        about += [UNDER_SKY] if scene.environment is not None else []
    maps = "".join(f'<figure><img src="{parts["flip"]}" alt="FLIP map of {escape(label)}">'
                   f"<figcaption>{escape(label)}</figcaption></figure>"
                   for label, parts in images.items() if label != compared_to)
    data = json.dumps({scene.name: images}).replace("</", "<\\/")  # "</" would end the script
    return fill_page("side_by_side.html", title=escape(scene.name), about=escape("; ".join(about)),
                     first=escape(next(iter(pictures))), reference=escape(compared_to), maps=maps,
                     numbers=_numbers(errors, compared_to), pictures=data)


def _numbers(errors: Mapping[str, Mapping[str, Errors]], compared_to: str) -> str:
    layers = [layer for layer in LAYERS if any(layer in found for found in errors.values())]
    head = [f"against {compared_to}", *(text for _ in layers for text in COLUMNS.values())]
    above = "<tr><td>" + "".join(f"<th colspan={len(COLUMNS)}>{layer}" for layer in layers)
    body = [[label, *(number(found[layer][m]) if layer in found else "–" for layer in layers for m in COLUMNS)]
            for label, found in errors.items()]
    return html_table(head, body, above)
