"""A function's result at the latest time, kept for all who ask for it."""

from collections.abc import Callable
from typing import Generic, TypeVar

Result = TypeVar("Result")


class Latest(Generic[Result]):
    """Calls ``function`` with seconds, once as long as these are the same."""

    def __init__(self, function: Callable[[float], Result]) -> None:
        self._function = function
        self._kept: tuple[float, Result] | None = None

    def __call__(self, time: float) -> Result:
        kept = self._kept  # in one step, since several threads may ask
        if kept is None or kept[0] != time:
            kept = self._kept = time, self._function(time)
        return kept[1]
