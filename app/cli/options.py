"""Texts of the command line into values."""

from __future__ import annotations

import difflib
from collections.abc import Collection
from fractions import Fraction
from pathlib import Path

from app.errors import SettingsError

FORMATS = ("exr", "png")


def parse_folder(text: str | Path) -> Path:
    """A folder that was named; without a name it would be the current one.

    Raises
    ------
    SettingsError
        When the text is empty.
    """
    if not str(text).strip():
        raise SettingsError("no name given", "--out", "expected a folder, such as out, or . for the current one")
    return Path(text)


def parse_names(text: str, known: Collection[str], option: str) -> tuple[str, ...]:
    """Names separated by commas, each once and in the given order.

    Raises
    ------
    SettingsError
        When there is none, or one is not among ``known``.
    """
    names = tuple(dict.fromkeys(part.strip() for part in text.split(",") if part.strip()))
    if not names:
        raise SettingsError("no name given", option, f"expected one or more of {', '.join(known)}")
    for name in names:
        if name not in known:
            raise unknown(name, known, option)
    return names


def parse_scale(text: str, option: str) -> float:
    """A network's grid relative to the image, such as ``1/8`` or ``0.25``.

    Raises
    ------
    SettingsError
        When it is no number above 0 and at most 1.
    """
    try:
        scale = float(Fraction(text))
    except (ValueError, ZeroDivisionError):
        raise SettingsError(f"bad scale {text!r}", option, "expected such as 1/8 or 0.25") from None
    if not 0 < scale <= 1:
        raise SettingsError(f"bad scale {text!r}", option, "expected a number above 0, at most 1")
    return scale


def unknown(name: str, known: Collection[str], option: str) -> SettingsError:
    """Error for a name that is not ``known``, with the nearest one that is."""
    near = difflib.get_close_matches(name, known, 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return SettingsError(f"unknown name {name!r}", option, f"{hint}expected one of {', '.join(known)}")
