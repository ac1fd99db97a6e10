"""The command line, with one file per command. ``render`` runs if no command is named."""

import errno
import os
import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from app import __version__
from app.cli.batch import batch
from app.cli.bench import bench
from app.cli.compare import compare
from app.cli.doctor import doctor
from app.cli.golden import golden
from app.cli.models import models
from app.cli.render import render
from app.cli.view import view
from app.errors import AfterglowError, SettingsError, did_you_mean
from app.settings import command_line_error

DEFAULT = "render"
USER_ERROR = 2


class DefaultGroup(TyperGroup):
    """Runs ``render`` if no command is named; prints a user's error as one line and exits with code 2."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        own = {name for parameter in self.get_params(ctx) for name in parameter.opts}
        named = bool(args) and (args[0] in self.commands or args[0] in own)
        if args and not named and re.fullmatch(r"[a-z]+", args[0]) and not Path(args[0]).exists():
            raise SettingsError(f"no command or scene file {args[0]!r}", "command line",
                                f"{did_you_mean(args[0], self.commands)}, or a scene file")
        return super().parse_args(ctx, args if named else [DEFAULT, *args])

    def main(self, *args: Any, **options: Any) -> NoReturn:
        try:
            status = super().main(*args, **{**options, "standalone_mode": False})
        except AfterglowError as error:
            _print_error(command_line_error(error))
            status = USER_ERROR
        except typer.TyperException as error:
            if message := error.format_message():  # empty when a group without a command has printed its help
                _print_error(f"command line: {_reworded(message)}")
            status = USER_ERROR
        except typer.Abort:
            status = 1
        except OSError as error:
            if error.filename is not None:
                _print_error(f"{error.filename}: {error.strerror} (expected a file or folder that can be used)")
            elif error.errno in (errno.ENOSPC, errno.EIO):
                _print_error(f"standard output: can't be written, {error.strerror} (expected room for a few lines)")
            else:
                raise
            status = USER_ERROR
        sys.exit(status)


def _reworded(message: str) -> str:
    """What Typer says of a bad argument, with what was expected in brackets at the end."""
    text = f"{message[:1].lower()}{message[1:].rstrip('. ')}"
    where, _, expected = text.partition(": Input should be ")
    if not expected:
        return f"{text} (--help lists the options)"
    expected = expected.partition(", unable to parse")[0]
    return f"{where} (expected {'' if expected.startswith('a ') else 'a value '}{expected})"


def _print_error(message: str) -> None:
    with suppress(OSError):  # the exit code still says it
        typer.echo(typer.style("error:", fg="red", bold=True) + " " + " ".join(message.split()), err=True)


cli = typer.Typer(
    name="afterglow",
    cls=DefaultGroup,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    subcommand_metavar="[COMMAND] [ARGS]...",
    context_settings={"help_option_names": ["--help", "-h"]},
)
cli.command(DEFAULT)(render)
cli.command("models")(models)
cli.command("view")(view)
cli.command("compare")(compare)
cli.command("bench")(bench)
cli.command("doctor")(doctor)
cli.command("batch")(batch)
cli.add_typer(golden, name="golden")


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"afterglow {__version__}")
        raise typer.Exit


@cli.callback()
def _about(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True,
                                          help="Print the version and exit.")] = False,
) -> None:
    """Render a scene with OpenGL, with indirect light from an ONNX network.

    Without a command, [bold]render[/bold] runs: all its options are in
    [cyan]python -m app render --help[/cyan].

    [bold]Examples[/bold]

    [cyan]python -m app[/cyan]  [dim]# the embedded Cornell box, into out/[/dim]

    [cyan]python -m app scene.glb --size 640x480 --camera orbit --frames 60[/cyan]  [dim]# orbit a scene[/dim]

    [cyan]python -m app view scene.glb[/cyan]  [dim]# the same scene live, in a browser[/dim]

    [cyan]python -m app models[/cyan]  [dim]# bundled networks[/dim]

    [cyan]python -m app doctor[/cyan]  [dim]# what draws and infers here, and what is missing[/dim]
    """


def main() -> None:
    """Run the command line with the arguments of the process."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # it was closed by the shell
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115
    cli()
