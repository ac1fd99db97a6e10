"""``python -m export gather``: frames with gathered light, and the network that cleans it."""

from pathlib import Path
from typing import Annotated

import typer

from app.errors import SettingsError
from app.io.atomic_files import prepare_folders, replace_file
from app.io.terminal import counting_progress, say

cli = typer.Typer(no_args_is_help=True, help="Make frames with gathered light, and train the network that cleans it.")


@cli.command()
def make(out: Annotated[Path, typer.Option(help="Folder of the frames; those that exist are kept.", metavar="DIR")],
         scenes: Annotated[int, typer.Option(help="Generated scenes, up to 2 frames each.", min=1, metavar="N")] = 32,
         seed: Annotated[int, typer.Option(help="Seed of all random numbers.", min=0)] = 0) -> None:
    """Make the missing frames."""
    from export.dataset.gathered_frames import make_frames

    with counting_progress() as bar:
        task = bar.add_task("scenes", total=scenes)
        make_frames(out, scenes, seed, lambda done: bar.update(task, completed=done))


@cli.command()
def train(frames: Annotated[Path, typer.Argument(help="Folder of frames.", metavar="DIR")],
          out: Annotated[Path | None, typer.Option(help="File of the weights.", metavar="FILE.pt",
                                                   show_default="NAME.pt")] = None,
          minutes: Annotated[float, typer.Option(help="How long to train.", min=0.01)] = 30.0,
          seed: Annotated[int, typer.Option(help="Seed of all random numbers.", min=0)] = 0,
          network: Annotated[str, typer.Option(help="Which network: final-gather, one with parts of a published one, "
                                                    "or one of the ablations.", metavar="NAME")] = "final-gather"
          ) -> None:
    """Train a network, and write its weights."""
    import torch

    from export.dataset.gathered_frames import read_frames
    from export.models.gather_cleaners import CLEANERS
    from export.training.final_gather import train as train_network

    if network not in CLEANERS:
        raise SettingsError(f"no network {network!r} for gathered light", "--network",
                            f"expected one of: {', '.join(CLEANERS)}")
    out, examples = out or Path(f"{network}.pt"), read_frames(frames)
    prepare_folders(out.parent)
    trained = train_network(examples, 60 * minutes, seed, lambda step, seconds, loss: say(
        f"step {step}, {seconds:.0f} s, loss {loss:.4f}"), name=network)
    with replace_file(out) as temporary:
        torch.save({"name": network, "weights": trained.state_dict()}, temporary)


@cli.command()
def write(weights: Annotated[Path, typer.Argument(help="File of gather train.", metavar="FILE.pt")],
          trained_on: Annotated[str, typer.Option(help="For the contract.")] = "frames of python -m export gather make",
          out: Annotated[Path | None, typer.Option(help="Folder to write to.", show_default="nets/")] = None) -> None:
    """Write the network as an ONNX file, compared with torch."""
    from app.paths import nets_dir
    from export.onnx.export import export_cleaner

    say(str(export_cleaner(weights, trained_on, out or nets_dir())))
