"""Configurations in TOML files, checked by pydantic."""

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from app.errors import SettingsError

T = TypeVar("T")

strict = dataclass(frozen=True, kw_only=True, config=ConfigDict(extra="forbid"))


class JsonTable:
    """A base of configurations that can be saved."""

    def to_json(self) -> dict[str, Any]:
        """The configuration as JSON values, which ``config_from_table`` of its module reads back."""
        return dict(TypeAdapter(type(self)).dump_python(self, mode="json"))


def read_toml(path: Path) -> dict[str, Any]:
    """The table in a TOML file.

    Raises
    ------
    SettingsError
        When the file can't be read.
    """
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise SettingsError(f"can't read the configuration ({error})", path, "expected a TOML file") from None


def parse_table(kind: type[T], table: object, where: object, expected: str) -> T:
    """The configuration of class ``kind`` in a TOML or JSON table.

    Parameters
    ----------
    where : object
        The source of the table, and ``expected`` what it should hold, in errors.

    Raises
    ------
    SettingsError
        When a key is missing, unknown or has an invalid value.
    """
    try:
        return TypeAdapter(kind).validate_python(table)
    except ValidationError as errors:
        first = errors.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        what = f"bad key {key!r}" if key else "bad configuration"
        raise SettingsError(f"{what}: {first['msg']}", where, expected) from None
