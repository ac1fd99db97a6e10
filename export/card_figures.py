"""What validation found, at the end of a network's model card."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from app.atomic import write_text
from app.bench.configurations import NONE
from app.bench.judge import AMBIENT
from app.contract import SSGI, find_model
from export.frame_times import Milliseconds
from export.judge import ALL, SCALED, Row, by_scene

HEADING = "**On the validation views**"
FLOORS = (NONE, SSGI, SCALED, AMBIENT)  # beside which a network stands, where they were judged


def write_figures(models: Sequence[str], rows: Sequence[Row], times: Milliseconds) -> None:
    """Bring the card beside each of the judged networks up to date, where there is one."""
    files = [find_model(name) for name in models if name != NONE]
    cards = [(file.with_suffix(".md"), file.stem) for file in files if isinstance(file, Path)]
    for path, label in cards:
        if path.is_file():
            write_text(path, with_figures(path.read_text(encoding="utf-8"), label, rows, times))


def with_figures(card: str, network: str, rows: Sequence[Row], times: Milliseconds) -> str:
    """``card`` with a section for ``network`` in place of any that it had.

    Parameters
    ----------
    network : str
        The label that it was judged under.
    times : dict of str to dict
        Milliseconds of a frame by scene and model; may be empty.
    """
    means = {(row["scene"], row["model"]): row for row in by_scene(rows)}
    scenes = dict.fromkeys(scene for scene, _ in means)
    judged = [model for model in dict.fromkeys((*FLOORS, network)) if (ALL, model) in means]
    head = ["scene", "views", *(f"`{m}`" if m != AMBIENT else m for m in judged)]
    lines = [[scene, str(means[scene, network]["views"]), *(_cell(means[scene, m]) for m in judged)]
             for scene in scenes]
    table = "".join(f"| {' | '.join(line)} |\n" for line in (head, ["---"] * len(head), *lines))
    begin = card.partition(HEADING)[0].rstrip()
    return (f"{begin}\n\n{HEADING}, PSNR in dB and HDR-FLIP of the final picture (docs/accuracy.md has more)\n\n"
            f"{table}{_latency(network, times)}")


def _cell(row: dict[str, float]) -> str:
    return f"{row['final.psnr']:.2f}, {row['final.flip']:.3f}"


def _latency(network: str, times: Milliseconds) -> str:
    if not times:
        return ""
    frame, without = times[ALL][network], times[ALL].get(NONE)
    beside = "" if without is None else f", {without:.0f} ms without indirect light, both"
    return f"\nA frame takes {frame:.0f} ms{beside} as means of the scenes; docs/accuracy.md names machine and size.\n"
