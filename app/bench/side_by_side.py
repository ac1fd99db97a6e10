"""Models of one scene beside each other and the truth: one HTML page that needs no other file."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from app.bench.configurations import Configuration
from app.bench.judge import METRICS, UNDER_SKY, Errors, draw_layers, errors_of
from app.bench.pictures import shown
from app.bench.report import COLUMNS, LAYERS, fill_page, html_table
from app.bench.tables import number
from app.bench.truth import Truth
from app.scene import Camera, Scene

F32 = NDArray[np.float32]
TRUTH = "truth"


def side_by_side(scene: Scene, camera: Camera, configurations: Sequence[Configuration], truth: Truth | None,
                 provider: str, progress: Callable[[str], None] = lambda _: None) -> str:
    """Draw, judge, and lay out.

    Parameters
    ----------
    configurations : sequence of Configuration
        Without a truth, at least two: the last one is what the others are compared with.
    """
    pictures: dict[str, F32] = {}
    errors: dict[str, Mapping[str, Errors]] = {}
    for configuration in configurations:
        progress(configuration.label)
        layers = draw_layers(scene, camera, configuration, provider)
        pictures[configuration.label] = layers["final"]
        errors[configuration.label] = errors_of(layers, truth) if truth is not None else {}
    if truth is not None:
        pictures[TRUTH] = truth.layers["final"]
    reference = list(pictures)[-1]
    if truth is None:
        errors = {label: {"final": {name: metric(picture, pictures[reference]) for name, metric in METRICS.items()}}
                  for label, picture in pictures.items() if label != reference}
    return _page(scene, pictures, reference, errors, truth)


def _page(scene: Scene, pictures: dict[str, F32], reference: str, errors: Mapping[str, Mapping[str, Errors]],
          truth: Truth | None) -> str:
    images = shown(pictures, reference)
    height, width = pictures[reference].shape[:2]
    about = [f"{width}×{height}, {scene.triangles} triangles", *([scene.lighting] if scene.lighting else [])]
    if truth is not None:
        about += [f"truth of {truth.about['spp']} samples per pixel"] if "spp" in truth.about else []
        about += truth.about.get("notices", [])
        about += [UNDER_SKY] if scene.environment is not None else []
    maps = "".join(f'<figure><img src="{parts["flip"]}" alt="FLIP map of {escape(label)}">'
                   f"<figcaption>{escape(label)}</figcaption></figure>"
                   for label, parts in images.items() if label != reference)
    data = json.dumps({scene.name: images}).replace("</", "<\\/")  # "</" would end the script
    return fill_page("side_by_side.html", title=escape(scene.name), about=escape("; ".join(about)),
                     first=escape(next(iter(pictures))), reference=escape(reference), maps=maps,
                     numbers=_numbers(errors, reference), pictures=data)


def _numbers(errors: Mapping[str, Mapping[str, Errors]], reference: str) -> str:
    layers = [layer for layer in LAYERS if any(layer in found for found in errors.values())]
    head = [f"against {reference}", *(text for _ in layers for text in COLUMNS.values())]
    above = "<tr><td>" + "".join(f"<th colspan={len(COLUMNS)}>{layer}" for layer in layers)
    body = [[label, *(number(found[layer][m]) if layer in found else "–" for layer in layers for m in COLUMNS)]
            for label, found in errors.items()]
    return html_table(head, body, above)
