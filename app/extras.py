"""Optional packages, imported by the commands that need them."""

import importlib
from typing import Any

from app.errors import MissingExtraError

EVALUATION_PACKAGES = ("flip_evaluator", "matplotlib", "psutil", "pyoidn", "skimage")  # that comparing pictures needs


def extra_module(name: str, extra: str) -> Any:
    """Import module ``name``, which the optional ``extra`` of this package installs.

    Raises
    ------
    MissingExtraError
        When it can't be imported; names the command that installs it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingExtraError(f"can't import {name} ({' '.join(str(error).split())})", f"extra {extra}",
                                f"install it with: pip install 'afterglow[{extra}]'") from None


def require_evaluation_packages() -> None:
    """Check that all packages of the extra ``evaluation`` are installed, before any long work begins.

    Raises
    ------
    MissingExtraError
        When one is missing.
    """
    for name in EVALUATION_PACKAGES:
        extra_module(name, "evaluation")
