"""One exception per kind of user error.

``python -m app`` prints any of them as one line, ``error: what, where, what was expected``,
and leaves with exit code 2.
"""

from __future__ import annotations


class AfterglowError(Exception):
    """A mistake in what the user gave: what, where, what was expected.

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
        super().__init__(f"{what}, {where}, {expected}")
        self.what, self.where, self.expected = what, where, expected

    def __reduce__(self) -> tuple[type[AfterglowError], tuple[str, object, str]]:
        return type(self), (self.what, self.where, self.expected)  # so that it passes between processes


class SceneError(AfterglowError):
    """A scene, texture or scene JSON file that can't be used."""


class ModelError(AfterglowError):
    """A network or its contract that can't be used."""


class SettingsError(AfterglowError):
    """An option or setting outside its range."""


class DeviceError(AfterglowError):
    """No OpenGL context, or not the device that was demanded."""


class OutputError(AfterglowError):
    """A file or folder that can't be written."""


class GraphError(AfterglowError):
    """Passes that don't fit together, or one that touches what it did not declare."""


class ShaderError(AfterglowError):
    """A shader that does not compile, or a uniform that it does not have."""


class MissingExtraError(AfterglowError):
    """An optional package that this command needs is not installed."""


class MetricError(AfterglowError):
    """Images that can't be compared."""


class PathTracerError(AfterglowError):
    """A path tracer that failed, or a reference that does not fit the scene."""
