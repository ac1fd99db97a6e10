"""How the command line finds its command, and how its errors look."""

from __future__ import annotations

import sys
from typing import Any, NoReturn

import typer
from typer.core import TyperGroup

from app.errors import AfterglowError

DEFAULT = "render"
USER_ERROR = 2


class DefaultGroup(TyperGroup):
    """Commands of which ``render`` is meant when none is named; a user's error is one line and exit code 2."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        own = {name for parameter in self.get_params(ctx) for name in parameter.opts}
        named = bool(args) and (args[0] in self.commands or args[0] in own)
        return super().parse_args(ctx, args if named else [DEFAULT, *args])

    def main(self, *args: Any, **options: Any) -> NoReturn:
        try:
            status = super().main(*args, **{**options, "standalone_mode": False})
        except AfterglowError as error:
            _say(str(error))
            status = USER_ERROR
        except typer.TyperException as error:
            _say(f"{_sentence(error.format_message())}, command line, expected what --help lists")
            status = USER_ERROR
        except typer.Abort:
            status = 1
        sys.exit(status)


def _say(message: str) -> None:
    typer.echo(typer.style("error:", fg="red", bold=True) + " " + " ".join(message.split()), err=True)


def _sentence(message: str) -> str:
    return message[:1].lower() + message[1:].rstrip(". ")
