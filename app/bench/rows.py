"""The results as rows: for the CSV file, and for people."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator
from typing import Any

from app.evaluation.configurations import NONE
from app.evaluation.picture_errors import AMBIENT

Json = dict[str, Any]
Row = dict[str, object]


def rows(results: Json) -> Iterator[Row]:
    """A flat row for each configuration, baseline and oracle of each scene; times in milliseconds.

    A baseline's time is a single measurement, which has no percentiles.
    """
    for scene in results["scenes"]:
        for c in scene["configurations"]:
            row: Row = {"scene": scene["name"], "kind": "none" if c["label"] == NONE else "renderer",
                        "label": c["label"], "size": _by(c["size"]), "grid": c["grid"] and _by(c["grid"]),
                        "precision": c["precision"], "provider": c["device"]["provider"],
                        "gl_renderer": c["device"]["gl_renderer"], **(c["fresh"] or {}), **_errors(c["errors"])}
            for stage, spread in c["stages"].items():
                row |= {f"{stage}.median_ms": spread["median"], f"{stage}.p95_ms": spread["p95"]}
            yield row
        size = _by(scene["reference"]["size"])
        yield {"scene": scene["name"], "kind": "oracle", "label": AMBIENT, "size": size,
               **_errors(scene["ambient"]["errors"])}
        for r in scene["baselines"]:
            yield {"scene": scene["name"], "kind": "baseline", "label": r["name"], "size": size, "spp": r["spp"],
                   "frame.median_ms": r["ms"], **_errors(r["errors"])}


def to_csv(found: Iterable[Row]) -> str:
    """CSV with a header of all columns that occur."""
    listed = list(found)
    columns = list(dict.fromkeys(column for row in listed for column in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(listed)
    return text.getvalue()


def number(value: float | None, digits: int = 3) -> str:
    """A figure for people; the infinite PSNR of equal images is stored as None."""
    return "∞" if value is None else f"{value:.{digits}g}" if abs(value) < 100 else f"{value:.0f}"


def _errors(errors: Json | None) -> Row:
    return {f"{layer}.{metric}": value for layer, values in (errors or {}).items() for metric, value in values.items()}


def _by(size: list[int]) -> str:
    return f"{size[0]}x{size[1]}"
