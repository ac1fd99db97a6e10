"""The way of a network's tensors: from what passes have packed, through onnxruntime, to light that passes draw with."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import moderngl

from app.arrays import F32
from app.gl.pool import Resources


class Exchange(ABC):
    """Runs one network on a screen grid of one size.

    Attributes
    ----------
    name : str
        ``copy``, ``mapped`` or ``cuda``.
    """

    name: ClassVar[str]

    @abstractmethod
    def run(self, tensors: Mapping[str, moderngl.Buffer | F32]) -> None:
        """Infer one frame.

        Parameters
        ----------
        tensors : mapping of str to Buffer or ndarray, float32
            For each input its ``TensorSpec.shape``: buffers of what is seen, arrays of the rest. An array must hold the
            same numbers when it is passed again.

        Raises
        ------
        ModelError
            When onnxruntime fails or a tensor has another shape.
        """

    @abstractmethod
    def read(self, channel: str) -> F32:
        """A channel on surfels that ``run`` has computed, finite and inside its range, shape (C, S)."""

    @abstractmethod
    def draw(self, channel: str, resources: Resources, target: str) -> None:
        """Write such a channel of three components to the texture ``target``, with an alpha of 1."""

    @abstractmethod
    def release(self) -> None:
        """Free all buffers; the exchange can't be used afterwards."""
