"""Texts of the command line into values."""

from __future__ import annotations

from app.errors import ModelError, SettingsError

LARGEST_COUNT = 2**15


def known_networks(names: list[str] | None) -> list[str]:
    """Names of networks that can be exported; all without any.

    Raises
    ------
    ModelError
        When one is not known.
    """
    from export.models import UNTRAINED

    for name in names or ():
        if name not in UNTRAINED:
            raise ModelError(f"no network {name!r}", "python -m export", f"expected one of {', '.join(UNTRAINED)}")
    return names or list(UNTRAINED)


def parse_counts(text: str, option: str) -> list[int]:
    """Whole numbers from 1 to ``LARGEST_COUNT``, separated by commas.

    Raises
    ------
    SettingsError
        When one is not.
    """
    counts = [int(part) if part.strip().isdecimal() else 0 for part in text.split(",")]
    if min(counts) < 1 or max(counts) > LARGEST_COUNT:
        raise SettingsError(f"bad numbers of paths {text!r}", option,
                            f"expected whole numbers up to {LARGEST_COUNT}, such as 1,2,4")
    return counts
