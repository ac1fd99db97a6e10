"""``python -m export onnx``: writes networks as ONNX files with their contracts, and checks them."""

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from app.errors import ModelError, did_you_mean
from app.io.atomic_files import write_text
from app.io.terminal import print_table
from app.paths import nets_dir

LIGHT_FACTORS = (0.1, 10.0)  # of the linearity check
WHERE = "NETWORK"            # the argument that names networks

cli = typer.Typer(no_args_is_help=True, help="Write networks as ONNX files, store contracts in them and check them.")


class Precision(StrEnum):
    """Data type of tensors and weights."""

    SINGLE = "float32"
    HALF = "float16"


@cli.command()
def write(networks: Annotated[list[str] | None, typer.Argument(
              metavar="[NETWORK]…", help="Checkpoints of export train (.pt) or names of untrained networks.",
              show_default="all untrained networks")] = None,
          precision: Annotated[list[Precision] | None, typer.Option(
              help="Data type of a checkpoint's files; repeatable.", show_default="both")] = None,
          out: Annotated[Path | None, typer.Option(help="Folder to write to.", show_default="nets/")] = None) -> None:
    """Export networks with their contracts and compare them with torch; trained ones get a model card."""
    from export.onnx.export import export_checkpoint, export_network
    from export.training.checkpoint import load_checkpoint

    folder = out or nets_dir()
    checkpoints = [name for name in networks or () if name.endswith(".pt")]
    names = [name for name in networks or () if name not in checkpoints]
    for path in checkpoints:
        for file in export_checkpoint(load_checkpoint(Path(path)), folder, precision or tuple(Precision)):
            print(file)
    for name in _known_networks(names, ", or a checkpoint (.pt)") if names or not checkpoints else ():
        print(export_network(name, folder))


@cli.command()
def stamp(model: Annotated[Path, typer.Argument(help="The .onnx file, which is rewritten.")],
          contract: Annotated[Path, typer.Argument(help="JSON file that holds the contract.")]) -> None:
    """Store a contract in an .onnx file."""
    from app.network.contract_json import contract_from_json
    from export.onnx.export import stamp as stamp_file

    try:
        text = contract.read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8"
        raise ModelError(f"can't read the contract ({reason})", contract, "expected a JSON file") from None
    stamp_file(model, contract_from_json(text, contract))


@cli.command()
def restamp(models: Annotated[list[Path], typer.Argument(
                metavar="FILE…", help="The .onnx files with a contract of version 1, which are rewritten.")]) -> None:
    """Update networks with a contract of version 1: rename channels, grids and cached tensors."""
    from export.onnx.restamp import restamp as restamp_file

    for model in models:
        restamp_file(model)
        print(model)


@cli.command(name="list")
def list_presets(as_json: Annotated[bool, typer.Option(
                     "--json", help="Print a JSON list instead of a table.")] = False) -> None:
    """List all networks and discriminators that can be trained or exported, with their weight counts."""
    from export.models import DISCRIMINATORS, PRESETS, count_weights, make_network

    rows = []
    for preset in PRESETS:
        network = make_network(preset)
        contract = network.contract
        rows.append({"preset": preset, "weights": count_weights(network), "scale": contract.scale,
                     "bounces": contract.bounces})
    rows += [{"preset": name, "weights": count_weights(make())} for name, make in DISCRIMINATORS.items()]
    if as_json:
        typer.echo(json.dumps(rows, indent=1))
        return
    for row in rows:
        details = f", {row['scale']:g} of the image, {row['bounces']}" if "scale" in row else ""
        typer.echo(f"{row['preset']:22} {row['weights']:>10,} weights{details}")


@cli.command()
def precision(names: Annotated[list[str] | None, typer.Argument(
                  metavar="[NETWORK]…", help="Names of untrained networks.", show_default="all")] = None,
              scene: Annotated[list[Path] | None, typer.Option(
                  help="Scene files to render inputs from.", show_default="the bundled scenes")] = None,
              as_json: Annotated[Path | None, typer.Option(
                  "--json", help="Also write the rows as JSON.", metavar="FILE")] = None) -> None:
    """Measure the error of half precision in networks, and where it overflows."""
    from app.load import load_scene
    from export.onnx.precision import as_markdown, table
    from export.onnx.sample_inputs import default_scenes

    rows = table(_known_networks(names), {path.stem: load_scene(path) for path in scene} if scene else default_scenes())
    if as_json is not None:
        write_text(as_json, json.dumps([vars(row) for row in rows], indent=1))
    print(as_markdown(rows))


@cli.command()
def linearity(networks: Annotated[list[str] | None, typer.Argument(
        metavar="[NETWORK]…", help="Names of bundled networks, or paths.", show_default="all bundled networks")] = None,
        ) -> None:
    """Measure how far networks are from linear in light, without the renderer's exposure.

    Largest errors on the Cornell box and two generated scenes, relative to the largest value of each output: of
    f(L1 + L2) against f(L1) + f(L2), where L1 is the light in the left half of the input, and of f(αL) against αf(L).
    """
    from app.network.selection import bundled_models, find_model
    from app.network.session import Network
    from export.onnx.linearity import additivity, exposure_error
    from export.onnx.sample_inputs import RENDERED_SIZE, rendered_inputs

    table = Table("network", "f(L1 + L2)", *(f"f({factor:g} L)" for factor in LIGHT_FACTORS), box=box.SIMPLE)
    for name in networks or bundled_models():
        file = find_model(name, WHERE)
        if not isinstance(file, Path):
            raise ModelError(f"{name!r} is not a network", WHERE, "expected an .onnx file")
        contract = Network(file, RENDERED_SIZE, "cpu").contract  # checked against its graph
        model, inputs = file.read_bytes(), [arrays for _, arrays in rendered_inputs(contract)]
        errors = [max(additivity(model, x) for x in inputs),
                  *(max(exposure_error(model, factor, x) for x in inputs) for factor in LIGHT_FACTORS)]
        table.add_row(file.stem, *(f"{error:.1e}" for error in errors))
    print_table(table)


@cli.command()
def scaling(out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("scaling")) -> None:
    """Write untrained networks of increasing surfel count and width, for timing."""
    from export.onnx.export import export_scaling_networks

    for path in export_scaling_networks(out):
        print(path)


@cli.command()
def probe() -> None:
    """Write the probe networks of the golden images, which read every channel; needed after adding a channel."""
    from export.onnx.probe import write_probes

    for path in write_probes():
        print(path)


def _known_networks(names: list[str] | None, others: str = "") -> list[str]:
    """``names``, or all untrained networks if there are none.

    Parameters
    ----------
    others : str
        What the command takes besides; for the error.

    Raises
    ------
    ModelError
        When a name is unknown.
    """
    from export.models import UNTRAINED

    for name in names or ():
        if name not in UNTRAINED:
            raise ModelError(f"no untrained network {name!r}", WHERE, f"{did_you_mean(name, UNTRAINED)}{others}")
    return names or list(UNTRAINED)
