"""``python -m export models``: the presets that can be trained or exported."""

from __future__ import annotations

import json
from typing import Annotated

import typer


def models(as_json: Annotated[bool, typer.Option("--json", help="Print a JSON list instead of a table.")] = False,
           ) -> None:
    """List presets of networks, and discriminators that are trained beside them, with their numbers of weights."""
    from export.models import DISCRIMINATORS, PRESETS, make_network, weights_of

    rows = []
    for preset in PRESETS:
        network = make_network(preset)
        contract = network.contract
        rows.append({"preset": preset, "weights": weights_of(network), "scale": contract.scale,
                     "bounces": contract.bounces})
    rows += [{"preset": name, "weights": weights_of(make())} for name, make in DISCRIMINATORS.items()]
    if as_json:
        typer.echo(json.dumps(rows, indent=1))
        return
    for row in rows:
        how = f", {row['scale']:g} of the image, {row['bounces']}" if "scale" in row else ""
        typer.echo(f"{row['preset']:22} {row['weights']:>10,} weights{how}")
