"""One exception per kind of user error.

``python -m app`` prints any of them as one line, ``error: where: what is wrong (what was expected)``,
and leaves with exit code 2.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

MIN_SIMILARITY = 0.5  # of a known word to the one that was given, as difflib measures it


class AfterglowError(Exception):
    """A mistake in the user's input: where, what, and what was expected instead.

    Parameters
    ----------
    what : str
        What is wrong.
    where : object
        The file, key or option it was found in.
    expected : str
        What would have been right, or what to do about it.
    """

    def __init__(self, what: str, where: object, expected: str) -> None:
        super().__init__(f"{where}: {what} ({expected})")
        self.what, self.where, self.expected = what, where, expected

    def __reduce__(self) -> tuple[type[AfterglowError], tuple[str, object, str]]:
        return type(self), (self.what, self.where, self.expected)  # makes it picklable, to cross processes


class SceneError(AfterglowError):
    """A scene, texture or scene JSON file that can't be used."""


class ModelError(AfterglowError):
    """A network or its contract that can't be used."""


class SettingsError(AfterglowError):
    """An option or setting outside its range."""


class DeviceError(AfterglowError):
    """No OpenGL context, or a software renderer where a hardware one was required."""


class OutputError(AfterglowError):
    """A file or folder that can't be written."""


class GraphError(AfterglowError):
    """Passes that don't fit together, or a pass that accesses a resource it did not declare."""


class ShaderError(AfterglowError):
    """A shader that does not compile, or a uniform that it does not have."""


class MissingExtraError(AfterglowError):
    """An optional package that this command needs is not installed."""


class MetricError(AfterglowError):
    """Images that can't be compared."""


class ProcessError(AfterglowError):
    """A command of this program that failed in a process of its own, such as the path tracer."""


def did_you_mean(word: object, known: Iterable[str]) -> str:
    """What is expected in place of an unknown word: ``did you mean 'b'? expected one of: a, b``."""
    names = list(known)
    if not names:
        return "expected none, since there are none"
    nearest = difflib.get_close_matches(str(word), names, 1, MIN_SIMILARITY)
    hint = f"did you mean {nearest[0]!r}? " if nearest else ""
    return f"{hint}expected one of: {', '.join(names)}"
