"""Parts that the HTML pages share: templates with sliders between two pictures, embedded pictures, and tables."""

import base64
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import resources
from string import Template

import numpy as np
from PIL import Image

from app.arrays import F32, Bytes, Floats
from app.evaluation.metrics import METRICS, exposure_of, flip_map, tone_map
from app.evaluation.tables import format_number
from app.extras import extra_module
from app.io.image import to_8bit

LAYERS = ("final", "indirect", "direct")
QUALITY = 92  # of WebP


def fill_page(package: str, template: str, images: Mapping[str, object], **parts: str) -> str:
    """Fill a template of ``package`` with ``parts`` and with what its sliders need.

    Parameters
    ----------
    images : mapping
        By scene what ``embed_pictures`` returns.
    """
    here = resources.files("app.evaluation")
    style, script = ((here / f"slider.{kind}").read_text("utf-8").rstrip("\n") for kind in ("css", "js"))
    data = json.dumps(images).replace("</", "<\\/")  # "</" would end the script element
    text = (resources.files(package) / template).read_text("utf-8")
    return Template(text).substitute(slider_style=style, slider=script, pictures=data, **parts)


def embed_pictures(pictures: dict[str, F32], compared_to: str = "reference") -> dict[str, dict[str, str]]:
    """For each label the ``picture`` with the reference's exposure, and its ``flip`` map (dark for small errors).

    Parameters
    ----------
    pictures : dict of str to ndarray, float32, shape (H, W, 3)
        Linear.
    compared_to : str
        Label of the picture that the others are compared with.
    """
    reference = pictures[compared_to]
    exposure = exposure_of(reference)
    magma = extra_module("matplotlib", "evaluation").colormaps["magma"]
    return {label: {"picture": _webp(tone_map(image, exposure)),
                    "flip": _webp(np.asarray(magma(flip_map(image, reference)))[..., :3])}
            for label, image in pictures.items()}


def data_uri(pixels: Bytes, kind: str, **options: object) -> str:
    """Pixels as an image file of the given kind, with options of Pillow, in a data URI."""
    data = io.BytesIO()
    Image.fromarray(pixels).save(data, kind, **options)
    return f"data:image/{kind};base64," + base64.b64encode(data.getvalue()).decode()


def _webp(image: Floats) -> str:
    return data_uri(to_8bit(image), "webp", quality=QUALITY, method=6)


def html_table(head: Sequence[str], body: Iterable[Sequence[str]], above: str = "") -> str:
    """A table of texts that scrolls when it is too wide; ``above`` is HTML of rows before its head."""
    lines = [above, "<tr>" + "".join(f"<th>{escape(cell)}" for cell in head)]
    lines += ["<tr>" + "".join(f"<td>{escape(cell)}" for cell in row) for row in body]
    return "<div class=scroll><table>" + "".join(lines) + "</table></div>"


def layer_heads(layers: Sequence[str]) -> str:
    """Cells of a row above the head that spans the metrics of each layer."""
    return "".join(f"<th colspan={len(METRICS)}>{layer}" for layer in layers)


def error_cells(errors: Mapping[str, Mapping[str, float | None]], layers: Sequence[str]) -> list[str]:
    """One row's errors by layer and metric; a dash for each layer that was not compared."""
    return [format_number(errors[layer][metric]) if layer in errors else "–"
            for layer in layers for metric in METRICS]
