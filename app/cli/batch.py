"""``python -m app batch``: many jobs on the cores of this machine or on a Dask cluster, resumable."""

from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.markup import escape
from rich.table import Column, Table

from app.cli.options import parse_folder
from app.io.terminal import counting_progress, print_table

FAILED = 1  # exit code


def batch(
    jobs: Annotated[Path, typer.Argument(metavar="JOBS.jsonl", help="One JSON object per line.", show_default=False)],
    out: Annotated[Path, typer.Option(help="Folder with a folder for each job.", metavar="DIR", parser=parse_folder)
                   ] = Path("out/batch"),
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler.", metavar="tcp://…",
                                                  show_default="this machine's cores")] = None,
    workers: Annotated[int | None, typer.Option(help="Processes on this machine.", min=1, metavar="N",
                                                show_default="one per core")] = None,
) -> None:
    """Draw many pictures of many scenes, and only what is missing in the folder.

    The same command continues a batch that was interrupted. A bad job is one line of the table at the end, and makes
    the exit code 1; all others are drawn.

    [bold]Examples[/bold]

    [cyan]python -m app batch jobs.jsonl --out pictures[/cyan]  [dim]# a job per line, such as:[/dim]

    [dim]{"scene": "room.glb", "cameras": ["door", "window"], "size": [640, 480], "outputs": ["final"]}[/dim]
    """
    from app.batch.jobs import read_jobs
    from app.batch.run import run_batch
    from app.io.atomic_files import prepare_folders

    listed = read_jobs(jobs)
    prepare_folders(out)
    with counting_progress() as bar:
        task = bar.add_task("drawing")
        outcomes = run_batch(listed, out, lambda done, count: bar.update(task, completed=done, total=count), scheduler,
                             workers)
    table = Table("job", "drawn", "there already", Column("error", overflow="fold"), box=box.SIMPLE)
    for outcome in outcomes:
        table.add_row(outcome.name, str(outcome.drawn), str(outcome.kept), escape(outcome.error))
    print_table(table)
    if any(outcome.error for outcome in outcomes):
        raise typer.Exit(FAILED)
