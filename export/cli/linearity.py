"""``python -m export linearity``: whether a network's light adds up."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from export.cli.tables import print_table

FACTORS = (0.1, 10.0)


def linearity(
    networks: Annotated[list[str] | None, typer.Argument(
        metavar="[NETWORK]…", help="Names of bundled networks and paths; all bundled ones without any.")] = None,
) -> None:
    """Print how far networks alone, without the renderer's exposure, are from linear in light.

    The largest errors on the Cornell box and two generated scenes, relative to each output's largest value: of
    f(L1 + L2) against f(L1) + f(L2), where L1 is the light in the left half of the input, and of f(αL) against αf(L).
    """
    from app.contract import bundled_models, find_model
    from app.errors import ModelError
    from app.infer import Network
    from export.linearity import additivity, exposure_error
    from export.to_onnx import REAL_SIZE, real_cases

    shown = Table("network", "f(L1 + L2)", *(f"f({factor:g} L)" for factor in FACTORS), box=box.SIMPLE)
    for name in networks or bundled_models():
        file = find_model(name)
        if not isinstance(file, Path):
            raise ModelError(f"{name!r} is no network", "export linearity", "expected an .onnx file")
        contract = Network(file, REAL_SIZE, "cpu").contract  # checked against its graph
        model, inputs = file.read_bytes(), [arrays for _, arrays in real_cases(contract)]
        errors = [max(additivity(model, x) for x in inputs),
                  *(max(exposure_error(model, factor, x) for x in inputs) for factor in FACTORS)]
        shown.add_row(file.stem, *(f"{error:.1e}" for error in errors))
    print_table(shown)
