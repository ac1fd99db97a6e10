"""``python -m export onnx``: networks as ONNX files with their contracts inside, and checks of them."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.table import Table

from app.errors import ModelError
from app.io.atomic_files import write_text
from app.io.terminal import print_table
from app.paths import nets_dir

FACTORS = (0.1, 10.0)  # of light, whose effect on a network's output is checked

cli = typer.Typer(no_args_is_help=True, help="Write networks as ONNX files, stamp contracts into them, check them.")


class Precision(StrEnum):
    """Type of tensors and weights."""

    SINGLE = "float32"
    HALF = "float16"


@cli.command()
def write(networks: Annotated[list[str] | None, typer.Argument(
              metavar="[NETWORK]…", help="Checkpoints of export train (.pt), or names of networks without trained "
              "weights; all of the latter without any.")] = None,
          precision: Annotated[list[Precision] | None, typer.Option(
              help="Of a checkpoint's files; may be given more than once.", show_default="both")] = None,
          out: Annotated[Path | None, typer.Option(help="Folder to write to.", show_default="nets/")] = None) -> None:
    """Export networks with their contracts, checked against torch; trained ones with a model card."""
    from export.onnx.export import export_checkpoint, export_network
    from export.training.checkpoint import load

    folder = out or nets_dir()
    checkpoints = [name for name in networks or () if name.endswith(".pt")]
    names = [name for name in networks or () if name not in checkpoints]
    for path in checkpoints:
        for made in export_checkpoint(load(Path(path)), folder, precision or tuple(Precision)):
            print(made)
    for name in _known_networks(names) if names or not checkpoints else ():
        print(export_network(name, folder))


@cli.command()
def stamp(model: Annotated[Path, typer.Argument(help="An .onnx file; it is rewritten.")],
          contract: Annotated[Path, typer.Argument(help="JSON file with the contract.")]) -> None:
    """Put a contract into an .onnx file."""
    from app.network.contract import ModelContract
    from export.onnx.export import stamp as stamp_file

    try:
        text = contract.read_text()
    except OSError as error:
        raise ModelError(f"can't read the contract ({error.strerror})", contract, "expected a JSON file") from None
    stamp_file(model, ModelContract.from_json(text, contract))


@cli.command()
def restamp(models: Annotated[list[Path], typer.Argument(
                metavar="FILE…", help=".onnx files with a contract of version 1; they are rewritten.")]) -> None:
    """Bring networks with an older contract up to date: the names of channels, grids and cached tensors."""
    from export.onnx.restamp import restamp as restamp_file

    for model in models:
        restamp_file(model)
        print(model)


@cli.command(name="list")
def list_presets(as_json: Annotated[bool, typer.Option(
                     "--json", help="Print a JSON list instead of a table.")] = False) -> None:
    """List the networks and discriminators that can be trained or exported, with their numbers of weights."""
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
        details = f", {row['scale']:g} of the image, {row['bounces']}" if "scale" in row else ""
        typer.echo(f"{row['preset']:22} {row['weights']:>10,} weights{details}")


@cli.command()
def precision(names: Annotated[list[str] | None, typer.Argument(
                  metavar="[NETWORK]…", help="Networks without trained weights; all without any.")] = None,
              scene: Annotated[list[Path] | None, typer.Option(
                  help="Scene files to take real inputs from.", show_default="the bundled scenes")] = None,
              as_json: Annotated[Path | None, typer.Option(
                  "--json", help="Write the rows as JSON too.", metavar="FILE")] = None) -> None:
    """Print what half precision changes in networks, and where it overflows."""
    from app.load import load_scene
    from export.onnx.precision import as_markdown, default_scenes, table, to_json

    rows = table(_known_networks(names), {path.stem: load_scene(path) for path in scene} if scene else default_scenes())
    if as_json is not None:
        write_text(as_json, to_json(rows))
    print(as_markdown(rows))


@cli.command()
def linearity(networks: Annotated[list[str] | None, typer.Argument(
        metavar="[NETWORK]…", help="Names of bundled networks and paths; all bundled ones without any.")] = None) -> None:
    """Print how far networks alone, without the renderer's exposure, are from linear in light.

    The largest errors on the Cornell box and two generated scenes, relative to each output's largest value: of
    f(L1 + L2) against f(L1) + f(L2), where L1 is the light in the left half of the input, and of f(αL) against αf(L).
    """
    from app.network.contract import bundled_models, find_model
    from app.network.session import Network
    from export.onnx.export import REAL_SIZE, real_cases
    from export.onnx.linearity import additivity, exposure_error

    shown = Table("network", "f(L1 + L2)", *(f"f({factor:g} L)" for factor in FACTORS), box=box.SIMPLE)
    for name in networks or bundled_models():
        file = find_model(name)
        if not isinstance(file, Path):
            raise ModelError(f"{name!r} is not a network", "export onnx linearity", "expected an .onnx file")
        contract = Network(file, REAL_SIZE, "cpu").contract  # checked against its graph
        model, inputs = file.read_bytes(), [arrays for _, arrays in real_cases(contract)]
        errors = [max(additivity(model, x) for x in inputs),
                  *(max(exposure_error(model, factor, x) for x in inputs) for factor in FACTORS)]
        shown.add_row(file.stem, *(f"{error:.1e}" for error in errors))
    print_table(shown)


@cli.command()
def scaling(out: Annotated[Path, typer.Option(help="Folder to write to.")] = Path("scaling")) -> None:
    """Write networks of rising surfel count and width, without trained weights, to time them."""
    from export.onnx.scaling_networks import write_scaling_networks

    for path in write_scaling_networks(out):
        print(path)


@cli.command()
def probe() -> None:
    """Write the probe networks of the golden images, which read every channel; run it when there is a new channel."""
    from export.onnx.probe import write_probes

    for path in write_probes():
        print(path)


def _known_networks(names: list[str] | None) -> list[str]:
    """Names of networks that can be exported; all without any.

    Raises
    ------
    ModelError
        When one is not known.
    """
    from export.models import UNTRAINED

    for name in names or ():
        if name not in UNTRAINED:
            raise ModelError(f"no network {name!r}", "export onnx", f"expected one of {', '.join(UNTRAINED)}")
    return names or list(UNTRAINED)
