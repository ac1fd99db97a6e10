"""What a run leaves for people: ``log.jsonl``, its plot ``curve.png``, and pictures of examples."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from app.extras import extra_module
from app.io.atomic_files import replacing, write_text
from app.io.image import to_8bit, write_png
from app.network.channels import CHANNELS
from app.network.contract import ModelContract
from export.training.examples import Batch
from export.training.losses.loss_inputs import tone


class Log:
    """Lines of JSON, each with its ``step``: means of training terms, or ``validation`` terms.

    Lines beyond ``step``, of a run that was killed after its checkpoint, are dropped.
    """

    def __init__(self, folder: Path, step: int) -> None:
        self._path = folder / "log.jsonl"
        self._lines: list[dict[str, Any]] = [line for line in _read(self._path) if line["step"] <= step]

    def write(self, **values: Any) -> None:
        """Append a line."""
        self._lines.append(values)
        write_text(self._path, "".join(json.dumps(line) + "\n" for line in self._lines))

    def plot(self, path: Path) -> None:
        """Draw loss and validation loss over steps."""
        pyplot = extra_module("matplotlib.figure", "judge")
        figure = pyplot.Figure(figsize=(8, 4), layout="constrained")
        axes = figure.subplots()
        for key, style in (("loss", "-"), ("validation", "o-")):
            rows = [(line["step"], line[key]["loss"] if key == "validation" else line[key])
                    for line in self._lines if key in line]
            axes.plot(*zip(*rows, strict=True) if rows else ((), ()), style, label=key)
        axes.set(xlabel="step", ylabel="loss", yscale="log")
        axes.grid(alpha=0.3, which="both")
        axes.legend()
        with replacing(path) as temporary:
            figure.savefig(temporary, format="png", dpi=110)


def write_pictures(path: Path, batch: Batch, output: Tensor, contract: ModelContract) -> None:
    """One row for each example: the light that the network reads, its output, the target, three channels at a time."""
    parts = output.shape[1] // 3
    columns = [x for pair in zip(output.chunk(parts, 1), batch["target"].chunk(parts, 1), strict=True) for x in pair]
    lit = next(((f"current.{t}", rows) for t, spec in contract.inputs.items() if spec.grid == "screen"
                for name, rows in spec.rows() if CHANNELS[name].radiance), None)
    if lit is not None:
        columns.insert(0, batch[lit[0]][:, lit[1]])
    rows = torch.cat([tone(x) * batch["seen"] for x in columns], dim=3).permute(0, 2, 3, 1)
    picture = rows.flatten(0, 1).detach().cpu().numpy() / float(tone(torch.tensor(4.0)))
    write_png(path, to_8bit(np.clip(picture, 0, 1)))


def _read(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text("utf-8").splitlines()] if path.exists() else []


def mean_of(terms: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Means of terms of the same names."""
    return {name: sum(t[name] for t in terms) / len(terms) for name in terms[0]} if terms else {}
