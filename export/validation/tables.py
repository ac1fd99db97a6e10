"""Validation results as tables: in the terminal, in Markdown, and as a section of a network's model card."""

import re
from collections.abc import Sequence
from pathlib import Path

from app.errors import ModelError
from app.evaluation.metrics import METRICS
from app.evaluation.picture_errors import AMBIENT
from app.evaluation.tables import markdown_table
from app.io.atomic_files import write_text
from app.network.selection import NONE, SSGI, find_model
from export.validation.errors import ALL, DIRECT, NOISE, WHERE, Row, by_scene
from export.validation.timing import FrameTimes

COLUMNS = {f"{layer}.{name}": metric for layer in ("final", "indirect") for name, metric in METRICS.items()}
COLUMNS[DIRECT] = METRICS["psnr"]
TITLES = [metric.title for metric in METRICS.values()]
HEADER = ("scene", "model", *TITLES, f"indirect: {TITLES[0]}", *TITLES[1:], f"direct: {TITLES[0]}", "ms")
NOISE_HEADER = ("scene", *(f"noise of the reference: {layer}" for layer in NOISE))
UNKNOWN = "–"
HEADING = "## On the validation views"
SECTION = re.compile(rf"^{HEADING}\n.*?(?=^## |\Z)", re.MULTILINE | re.DOTALL)
BASELINES = (NONE, SSGI, "radiosity", AMBIENT)  # shown beside a network, if they were evaluated


def table_lines(rows: Sequence[Row], times: FrameTimes | None) -> list[list[str]]:
    """A line per model and scene, and for all views; ``HEADER`` names the columns."""
    milliseconds = times.milliseconds if times is not None else {}
    return [[row["scene"], row["model"], *(_format(row[key], metric.digits) for key, metric in COLUMNS.items()),
             f"{ms:.0f}" if (ms := milliseconds.get(row["scene"], {}).get(row["model"])) is not None else ""]
            for row in by_scene(rows)]


def noise_lines(rows: Sequence[Row]) -> list[list[str]]:
    """A line per scene, and for all views: the references' mean relative standard errors before denoising."""
    model = rows[0]["model"]  # all models share the references
    return [[row["scene"], *(_format(row[key], ".2%") for key in NOISE.values())]
            for row in by_scene([row for row in rows if row["model"] == model], tuple(NOISE.values()))]


def _format(value: float | None, digits: str) -> str:
    return UNKNOWN if value is None else format(value, digits)


def cards_of(models: Sequence[str]) -> dict[str, Path]:
    """The model card beside each named network, by the network's label.

    Raises
    ------
    ModelError
        When a network has no card.
    """
    files = [find_model(name, WHERE) for name in models if name != NONE]
    cards = {file.stem: file.with_suffix(".md") for file in files if isinstance(file, Path)}
    for label, card in cards.items():
        if not card.is_file():
            raise ModelError(f"no model card of {label!r} to update", card, "expected one beside the network")
    return cards


def write_figures(cards: dict[str, Path], rows: Sequence[Row], spp: int, times: FrameTimes | None) -> None:
    """Update the model cards of evaluated networks."""
    for label, path in cards.items():
        write_text(path, with_figures(path.read_text(encoding="utf-8"), label, rows, spp, times))


def with_figures(card: str, network: str, rows: Sequence[Row], spp: int, times: FrameTimes | None) -> str:
    """``card`` with a new section for ``network``, which replaces its old one or is appended.

    Parameters
    ----------
    network : str
        Its label in ``rows``.
    spp : int
        Paths per pixel of the reference.
    """
    means = {(row["scene"], row["model"]): row for row in by_scene(rows)}
    scenes = dict.fromkeys(scene for scene, _ in means)
    models = [model for model in dict.fromkeys((*BASELINES, network)) if (ALL, model) in means]
    head = ["scene", "views", *(f"`{m}`" if m != AMBIENT else m for m in models)]
    lines = [[scene, str(means[scene, network]["views"]), *(_cell(means[scene, m]) for m in models)]
             for scene in scenes]
    section = (f"{HEADING}\n\nPSNR in dB and HDR-FLIP of the final picture, against {spp} denoised paths a pixel:\n\n"
               f"{markdown_table(head, lines)}\n{_latency(network, times)}")
    if SECTION.search(card):
        return SECTION.sub(lambda match: section + ("" if match.end() == len(card) else "\n"), card, count=1)
    return f"{card.rstrip()}\n\n{section}"


def _cell(row: dict[str, float]) -> str:
    return f"{row['final.psnr']:.2f}, {row['final.flip']:.3f}"


def _latency(network: str, times: FrameTimes | None) -> str:
    if times is None:
        return ""
    means, size = times.milliseconds[ALL], "×".join(map(str, times.size))
    beside = f", {means[NONE]:.0f} ms without indirect light" if NONE in means else ""
    return f"\nA frame of {size} takes {means[network]:.0f} ms{beside}: means of the scenes; {times.device}.\n"
