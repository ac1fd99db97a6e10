"""What validation found, as a section of a network's model card."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from app.errors import ModelError
from app.evaluation.configurations import NONE
from app.evaluation.picture_errors import AMBIENT
from app.io.atomic_files import write_text
from app.network.contract import SSGI, find_model
from export.validation.errors import ALL, Row, by_scene
from export.validation.timing import FrameTimes

HEADING = "## On the validation views"
SECTION = re.compile(rf"^{HEADING}\n.*?(?=^## |\Z)", re.MULTILINE | re.DOTALL)
FLOORS = (NONE, SSGI, "radiosity", AMBIENT)  # beside which a network stands, where they were judged


def cards_of(models: Sequence[str]) -> dict[str, Path]:
    """The model card beside each network that is named, by its label.

    Raises
    ------
    ModelError
        When a network has none.
    """
    files = [find_model(name) for name in models if name != NONE]
    cards = {file.stem: file.with_suffix(".md") for file in files if isinstance(file, Path)}
    for label, card in cards.items():
        if not card.is_file():
            raise ModelError(f"no model card of {label!r} to write to", card, "expected one beside the network")
    return cards


def write_figures(cards: dict[str, Path], rows: Sequence[Row], spp: int, times: FrameTimes | None) -> None:
    """Bring the cards of judged networks up to date."""
    for label, path in cards.items():
        write_text(path, with_figures(path.read_text(encoding="utf-8"), label, rows, spp, times))


def with_figures(card: str, network: str, rows: Sequence[Row], spp: int, times: FrameTimes | None) -> str:
    """``card`` with a section for ``network``, in place of the one it had, or at the end.

    Parameters
    ----------
    network : str
        The label that it was judged under.
    spp : int
        Paths per pixel of the reference.
    """
    means = {(row["scene"], row["model"]): row for row in by_scene(rows)}
    scenes = dict.fromkeys(scene for scene, _ in means)
    judged = [model for model in dict.fromkeys((*FLOORS, network)) if (ALL, model) in means]
    head = ["scene", "views", *(f"`{m}`" if m != AMBIENT else m for m in judged)]
    lines = [[scene, str(means[scene, network]["views"]), *(_cell(means[scene, m]) for m in judged)]
             for scene in scenes]
    table = "".join(f"| {' | '.join(line)} |\n" for line in (head, ["---"] * len(head), *lines))
    section = (f"{HEADING}\n\nPSNR in dB and HDR-FLIP of the final picture, against {spp} denoised paths a pixel:\n\n"
               f"{table}{_latency(network, times)}")
    if SECTION.search(card):
        return SECTION.sub(lambda found: section + ("" if found.end() == len(card) else "\n"), card, count=1)
    return f"{card.rstrip()}\n\n{section}"


def _cell(row: dict[str, float]) -> str:
    return f"{row['final.psnr']:.2f}, {row['final.flip']:.3f}"


def _latency(network: str, times: FrameTimes | None) -> str:
    if times is None:
        return ""
    means, size = times.milliseconds[ALL], "×".join(map(str, times.size))
    beside = f", {means[NONE]:.0f} ms without indirect light" if NONE in means else ""
    return f"\nA frame of {size} takes {means[network]:.0f} ms{beside}: means of the scenes; {times.device}.\n"
