"""What a case of the catalogue is, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from app.network.channels import HALF_MAX

F32 = NDArray[np.float32]


@dataclass(frozen=True)
class Picture:
    """What stage ``stage`` wrote into ``resource``, by frame; [H, W, 1 to 4], top row first."""

    stage: str
    resource: str
    frames: dict[int, F32]


class Case(Protocol):
    """One entry of the catalogue: something that can be drawn again and again."""

    @property
    def name(self) -> str: ...

    def origin(self) -> str:
        """What draws it, with its version; goldens of another origin are compared more loosely."""
        ...

    def draw(self, saved: Path) -> list[Picture]:
        """Draw it anew, in the order of its stages; ``saved`` is the folder of its goldens, which may not exist."""
        ...


def half(pixels: F32) -> NDArray[np.float16]:
    """Pixels as a golden holds them; infinities become the largest halves."""
    return np.clip(pixels, -HALF_MAX, HALF_MAX).astype(np.float16)
