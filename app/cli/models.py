"""``python -m app models``: the models for indirect light by name, and the contracts of networks."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.markup import escape
from rich.table import Table

from app.io.terminal import print_table
from app.network.channels import CUBE, PANORAMA, RAYS, SURFELS
from app.network.contract import ModelContract, TensorSpec
from app.network.contract_json import read_contract
from app.network.selection import SSGI, bundled_models

CLASSICAL = {
    SSGI: {
        "reads": "screen: direct.rgb, emission.rgb, normal.world.xyz, depth",
        "writes": "screen: indirect.rgb",
        "scale": "0.5 of the image",
        "bounces": "single",
        "paper": "Therrien, Levesque and Gilet 2023, Screen Space Indirect Lighting with Visibility Bitmask",
    },
}


def models(
    as_json: Annotated[bool, typer.Option("--json", help="Print a JSON object by name instead of a table.")] = False,
) -> None:
    """List what `--model` knows by name: networks with their contracts, and the classical method.

    [bold]Examples[/bold]

    [cyan]python -m app models[/cyan]  [dim]# a table[/dim]

    [cyan]python -m app models --json[/cyan]  [dim]# the same for programs; only networks have files[/dim]
    """
    bundled = {name: (path, read_contract(path)) for name, path in bundled_models().items()}
    if as_json:
        networks = {name: {"file": str(path), "contract": contract.to_dict()}
                    for name, (path, contract) in bundled.items()}
        typer.echo(json.dumps({**networks, **CLASSICAL}, indent=2))
    else:
        print_table(_table(bundled))


def _table(bundled: Mapping[str, tuple[Path, ModelContract]]) -> Table:
    networks = {name: [*_rows(contract), ("file", str(path))] for name, (path, contract) in bundled.items()}
    table = Table("model", "contract", box=box.ROUNDED, show_lines=True)
    for name, rows in (networks | {name: list(about.items()) for name, about in CLASSICAL.items()}).items():
        inner = Table.grid(padding=(0, 2))
        for label, text in rows:
            inner.add_row(f"[dim]{label}[/dim]", escape(text))
        table.add_row(f"[bold]{escape(name)}[/bold]", inner)
    return table


def _rows(contract: ModelContract) -> list[tuple[str, str]]:
    rows = [(f"reads {tensor}", _tensor(spec)) for tensor, spec in contract.inputs.items()]
    rows += [(f"writes {tensor}", _tensor(spec)) for tensor, spec in contract.outputs.items()]
    rows += [
        ("scale", f"{contract.scale:g} of the image, padded to multiples of {contract.multiple_of}"),
        ("bounces", contract.bounces), ("exposure", contract.exposure), ("dtype", contract.dtype),
        ("scene extent", f"{contract.scene_extent:g}"), ("cube axes", contract.cube_axes or ""),
        ("caches", f"what depends on {contract.static_input} alone" if contract.static_input else ""),
        ("paper", contract.paper), ("trained on", contract.trained_on), ("licence", contract.licence),
    ]
    return [(label, text) for label, text in rows if text]


def _tensor(spec: TensorSpec) -> str:
    sizes = {CUBE: f" 6x{spec.size}x{spec.size}", PANORAMA: f" {spec.size}x{2 * (spec.size or 0)}",
             SURFELS: f" {spec.size}", RAYS: f" {spec.size}x{spec.rays}"}
    size = sizes.get(spec.grid, "")
    return f"{spec.grid}{size}: {', '.join(spec.channels)} ({spec.components} components)"
