"""What a network works out from one input alone, kept from frame to frame while that input stays the same.

The graph of such a network has, besides what its contract lists, a boolean input ``anew`` and for each output
``kept.N`` an input ``kept.N.before``. Where ``anew`` is false it takes those inputs for granted, and works out the rest
alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import onnxruntime as ort

ANEW, PREFIX, BEFORE = "anew", "kept.", ".before"
Tensors = Mapping[str, Any]

_TYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16}


class Kept:
    """The kept tensors of one session.

    Parameters
    ----------
    source : str or None
        Input tensor that they depend on; None for a network that keeps nothing.

    Raises
    ------
    ValueError
        When the graph is not made so.
    """

    def __init__(self, session: ort.InferenceSession, source: str | None) -> None:
        self._source = source
        found = {i.name: i for i in session.get_inputs()} if source is not None else {}
        before = [i for name, i in found.items() if name.startswith(PREFIX)]
        if source is not None and (ANEW not in found or found[ANEW].type != "tensor(bool)"):
            raise ValueError(f"no boolean input {ANEW!r}")
        made = {o.name + BEFORE: o.type for o in session.get_outputs()}
        for i in before:
            if i.type not in _TYPES or made.get(i.name) != i.type:
                raise ValueError(f"input {i.name!r} is a {i.type}, the output that it is fed from a {made.get(i.name)}")
        self._nothing = {i.name: np.zeros([0] * len(i.shape), _TYPES[i.type]) for i in before}
        self._names = [name.removesuffix(BEFORE) for name in self._nothing]
        self.forget()

    def forget(self) -> None:
        """Work everything out anew next time."""
        self._given: Any = None
        self._values: dict[str, Any] = {}

    def feeds(self, tensors: Tensors) -> dict[str, Any]:
        """What the graph is fed besides ``tensors``."""
        if self._source is None:
            return {}
        anew = self._given is None or not np.array_equal(tensors[self._source], self._given)
        return {ANEW: np.array(anew), **(self._nothing if anew else self._values)}

    def outputs(self, feeds: Tensors) -> list[str]:
        """What to ask the graph for besides its contract's outputs, when it is given ``feeds``."""
        return self._names if self._source is not None and feeds[ANEW] else []

    def take(self, tensors: Tensors, made: Sequence[Any]) -> None:
        """Keep what the graph ``made`` of ``outputs``; nothing when it was not asked."""
        if made and self._source is not None:
            self._given = tensors[self._source].copy()
            self._values = {name + BEFORE: value for name, value in zip(self._names, made, strict=True)}


def is_kept(name: str) -> bool:
    """Whether an input or output of a graph is one of these."""
    return name == ANEW or name.startswith(PREFIX)
