"""Packages that only some commands need, imported when they do."""

from __future__ import annotations

import importlib
from typing import Any

from app.errors import MissingExtraError


def extra_module(name: str, extra: str) -> Any:
    """Import module ``name``, which the optional ``extra`` of this package installs.

    Raises
    ------
    MissingExtraError
        With the command that installs it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingExtraError(f"can't import {name} ({' '.join(str(error).split())})", f"extra {extra}",
                                f"expected it installed: pip install 'afterglow[{extra}]'") from None
