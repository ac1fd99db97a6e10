"""The command line: a file per command. ``render`` runs when no command is named."""

from __future__ import annotations

from typing import Annotated

import typer

from app import __version__
from app.cli.bench import bench
from app.cli.compare import compare
from app.cli.golden import golden
from app.cli.group import DefaultGroup
from app.cli.models import models
from app.cli.render import render
from app.cli.view import view

cli = typer.Typer(
    name="afterglow",
    cls=DefaultGroup,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    subcommand_metavar="[COMMAND] [ARGS]...",
    context_settings={"help_option_names": ["--help", "-h"]},
)
cli.command("render")(render)
cli.command("models")(models)
cli.command("view")(view)
cli.command("compare")(compare)
cli.command("bench")(bench)
cli.add_typer(golden, name="golden")


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"afterglow {__version__}")
        raise typer.Exit


@cli.callback()
def _about(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True,
                                          help="Print the version and leave.")] = False,
) -> None:
    """Render a scene with OpenGL and let an ONNX network infer its indirect light.

    Without a command, [bold]render[/bold] runs: all its options are in
    [cyan]python -m app render --help[/cyan].

    [bold]Examples[/bold]

    [cyan]python -m app[/cyan]  [dim]# the embedded Cornell box, into out/[/dim]

    [cyan]python -m app scene.glb --size 640x480 --camera orbit --frames 60[/cyan]  [dim]# a turn around a scene[/dim]

    [cyan]python -m app view scene.glb[/cyan]  [dim]# the same scene live, in a browser[/dim]

    [cyan]python -m app models[/cyan]  [dim]# the networks that come along[/dim]
    """


def main() -> None:
    """Run the command line with the arguments of the process."""
    cli()
