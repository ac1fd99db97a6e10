"""Caches what a network computes from one input alone, as long as that input stays the same.

In addition to the tensors of its contract, the graph of such a network has a boolean input ``recompute``, and for each
output ``static.N`` an input ``static.N.previous``. If ``recompute`` is false, the graph uses these inputs instead of
computing them again.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import onnxruntime as ort

RECOMPUTE, PREFIX, PREVIOUS = "recompute", "static.", ".previous"
Tensors = Mapping[str, Any]

_TYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16}


class StaticCache:
    """The cached tensors of one session.

    Parameters
    ----------
    source : str or None
        Input tensor that they depend on; None for networks without a cache.

    Raises
    ------
    ValueError
        When the graph lacks the inputs and outputs described above.
    """

    def __init__(self, session: ort.InferenceSession, source: str | None) -> None:
        self._source = source
        inputs = {i.name: i for i in session.get_inputs()} if source is not None else {}
        if source is not None and (RECOMPUTE not in inputs or inputs[RECOMPUTE].type != "tensor(bool)"):
            raise ValueError(f"no boolean input {RECOMPUTE!r}")
        output_types = {o.name + PREVIOUS: o.type for o in session.get_outputs()}
        cached = [i for name, i in inputs.items() if name.startswith(PREFIX)]
        for i in cached:
            if i.type not in _TYPES or output_types.get(i.name) != i.type:
                raise ValueError(f"input {i.name!r} is a {i.type}, but its output is a {output_types.get(i.name)}")
        self._empty = {i.name: np.zeros([0] * len(i.shape), _TYPES[i.type]) for i in cached}
        self._outputs = [name.removesuffix(PREVIOUS) for name in self._empty]
        self.clear()

    def clear(self) -> None:
        """Recompute everything in the next frame."""
        self._source_value: Any = None
        self._values: dict[str, Any] = {}

    def feeds(self, tensors: Tensors) -> dict[str, Any]:
        """The inputs of the graph in addition to ``tensors``."""
        if self._source is None:
            return {}
        recompute = self._source_value is None or not np.array_equal(tensors[self._source], self._source_value)
        return {RECOMPUTE: np.array(recompute), **(self._empty if recompute else self._values)}

    def outputs(self, feeds: Tensors) -> list[str]:
        """The outputs to request in addition to the contract's when the graph is given ``feeds``."""
        return self._outputs if self._source is not None and feeds[RECOMPUTE] else []

    def update(self, tensors: Tensors, values: Sequence[Any]) -> None:
        """Cache the ``values`` of ``outputs``, if there are any."""
        if values and self._source is not None:
            self._source_value = tensors[self._source].copy()
            self._values = {name + PREVIOUS: value for name, value in zip(self._outputs, values, strict=True)}


def is_cache_tensor(name: str) -> bool:
    """Whether an input or output of a graph belongs to the cache instead of the contract."""
    return name == RECOMPUTE or name.startswith(PREFIX)
