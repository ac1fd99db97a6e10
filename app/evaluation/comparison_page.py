"""Models beside each other and the reference on one HTML page that needs no other file."""

from collections.abc import Callable, Mapping, Sequence
from html import escape

from app.arrays import F32
from app.evaluation.configurations import Configuration
from app.evaluation.html import LAYERS, embed_pictures, error_cells, fill_page, html_table, layer_heads
from app.evaluation.metrics import METRICS
from app.evaluation.picture_errors import Errors, draw_layers, errors_of
from app.evaluation.reference import Reference
from app.scene import Camera, Scene

REFERENCE = "reference"


def make_comparison_page(scene: Scene, camera: Camera, configurations: Sequence[Configuration],
                         reference: Reference | None, provider: str,
                         progress: Callable[[str], None] = lambda _: None) -> str:
    """Draw all configurations, measure their errors, and return the page.

    Parameters
    ----------
    configurations : sequence of Configuration
        Without a reference at least two: the others are compared with the last one.
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
        other = pictures[compared_to]
        errors = {label: {"final": {name: metric.measure(picture, other) for name, metric in METRICS.items()}}
                  for label, picture in pictures.items() if label != compared_to}
    return _page(scene, pictures, compared_to, errors, reference)


def _page(scene: Scene, pictures: dict[str, F32], compared_to: str, errors: Mapping[str, Mapping[str, Errors]],
          reference: Reference | None) -> str:
    images = embed_pictures(pictures, compared_to)
    height, width = pictures[compared_to].shape[:2]
    about = [f"{width}×{height}, {scene.triangles} triangles", *([scene.lighting] if scene.lighting else [])]
    if reference is not None:
        about += [f"reference of {reference.about['spp']} samples per pixel"] if "spp" in reference.about else []
        about += reference.about.get("notices", [])
    maps = "".join(f'<figure><img src="{image["flip"]}" alt="FLIP map of {escape(label)}">'
                   f"<figcaption>{escape(label)}</figcaption></figure>"
                   for label, image in images.items() if label != compared_to)
    return fill_page("app.evaluation", "comparison_page.html", {scene.name: images}, title=escape(scene.name),
                     about=escape("; ".join(about)), first=escape(next(iter(pictures))),
                     reference=escape(compared_to), maps=maps, numbers=_numbers(errors, compared_to))


def _numbers(errors: Mapping[str, Mapping[str, Errors]], compared_to: str) -> str:
    layers = [layer for layer in LAYERS if any(layer in measured for measured in errors.values())]
    head = [f"against {compared_to}", *(metric.title for _ in layers for metric in METRICS.values())]
    body = [[label, *error_cells(measured, layers)] for label, measured in errors.items()]
    return html_table(head, body, "<tr><td>" + layer_heads(layers))
