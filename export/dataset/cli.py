"""``python -m export dataset``: pairs of neighbouring frames with path-traced targets."""

from pathlib import Path
from typing import Annotated

import typer

from app.io.terminal import counting_progress

cli = typer.Typer(no_args_is_help=True, help="Make datasets for training, and inspect them.")


@cli.command()
def make(out: Annotated[Path, typer.Option(help="Folder of the dataset; intact items are kept.", metavar="DIR")],
         frames: Annotated[int, typer.Option(help="Pairs of neighbouring frames.", min=1, metavar="N")],
         config: Annotated[Path | None, typer.Option(
             help="Sources and settings.", metavar="FILE.toml", show_default="a mix of sources")] = None,
         seed: Annotated[int, typer.Option(help="Seed of all random numbers.", min=0)] = 0,
         scheduler: Annotated[str | None, typer.Option(
             help="Address of a Dask scheduler.", metavar="tcp://…", show_default="this machine's cores")] = None,
         workers: Annotated[int | None, typer.Option(
             help="Processes on this machine.", min=1, show_default="one per core")] = None) -> None:
    """Make the missing, corrupt and outdated items of a dataset. The command can be stopped and resumed at any time."""
    from export.dataset.config import read_config
    from export.dataset.scheduler import make_dataset
    from export.reference.mitsuba_module import load_mitsuba

    load_mitsuba()  # fails here, before workers start, when something is missing
    settings = read_config(config)
    with counting_progress() as bar:
        task = bar.add_task("pairs", total=frames)
        made = make_dataset(out, settings, seed, frames, scheduler, workers, lambda n: bar.advance(task, n))
    print(f"{out}: {frames} pairs, {made} of them new")


@cli.command()
def sheet(dataset: Annotated[Path, typer.Argument(help="Folder of a dataset.", metavar="DIR")],
          out: Annotated[Path, typer.Argument(help="Image to write.", metavar="FILE.jpg")],
          count: Annotated[int, typer.Option(help="Pairs to show.", min=1, metavar="N")] = 40) -> None:
    """Write a contact sheet of a dataset's first pairs."""
    from export.dataset.contact_sheet import write_contact_sheet
    from export.dataset.dataset import Dataset

    write_contact_sheet(Dataset(dataset), out, count)
