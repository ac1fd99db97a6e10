"""Log of a training run: ``log.jsonl``, its plot ``curve.png``, and pictures of examples."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from app.extras import extra_module
from app.io.atomic_files import replace_file, write_text
from app.io.image import to_8bit, write_png
from app.network.channels import CHANNELS
from app.network.contract import ModelContract
from export.training.examples import Batch
from export.training.losses.loss_inputs import tone_map


class Log:
    """Lines of JSON with ``step`` and either means of the training terms or ``validation`` terms.

    Lines after ``step``, which a killed run wrote after its last checkpoint, are dropped.
    """

    def __init__(self, folder: Path, step: int) -> None:
        self._path = folder / "log.jsonl"
        written = self._path.read_text("utf-8").splitlines() if self._path.exists() else []
        self._lines: list[dict[str, Any]] = [line for line in map(json.loads, written) if line["step"] <= step]

    def write(self, **values: Any) -> None:
        """Append a line."""
        self._lines.append(values)
        write_text(self._path, "".join(json.dumps(line) + "\n" for line in self._lines))

    def plot(self, path: Path) -> None:
        """Plot training and validation loss over steps."""
        pyplot = extra_module("matplotlib.figure", "evaluation")
        figure = pyplot.Figure(figsize=(8, 4), layout="constrained")
        axes = figure.subplots()
        for key, style in (("loss", "-"), ("validation", "o-")):
            rows = [(line["step"], line[key]["loss"] if key == "validation" else line[key])
                    for line in self._lines if key in line]
            axes.plot(*zip(*rows, strict=True) if rows else ((), ()), style, label=key)
        axes.set(xlabel="step", ylabel="loss", yscale="log")
        axes.grid(alpha=0.3, which="both")
        axes.legend()
        with replace_file(path) as temporary:
            figure.savefig(temporary, format="png", dpi=110)


def write_pictures(path: Path, batch: Batch, output: Tensor, contract: ModelContract) -> None:
    """Write one row per example: the network's light input, its output and the target, three channels at a time."""
    count = output.shape[1] // 3
    columns = [x for pair in zip(output.chunk(count, 1), batch["target"].chunk(count, 1), strict=True) for x in pair]
    light = [batch[f"current.{t}"][:, rows] for t, spec in contract.inputs.items() if spec.grid == "screen"
             for name, rows in spec.rows() if CHANNELS[name].radiance]
    columns = [*light[:1], *columns]
    rows = torch.cat([tone_map(x) * batch["surface_mask"] for x in columns], dim=3).permute(0, 2, 3, 1)
    picture = rows.flatten(0, 1).detach().cpu().numpy() / float(tone_map(torch.tensor(4.0)))
    write_png(path, to_8bit(np.clip(picture, 0, 1)))


def mean_terms(terms: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Mean of each term; ``terms`` all have the same names."""
    return {name: sum(t[name] for t in terms) / len(terms) for name in terms[0]} if terms else {}
