"""A case of the catalogue, and the pictures it draws."""

from contextlib import closing
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from app.arrays import F32
from app.gl.context import Device
from app.network.channels import HALF_MAX


@dataclass(frozen=True)
class Picture:
    """What ``stage`` wrote into ``resource`` by frame number; images of shape (H, W, 1 to 4), top row first."""

    stage: str
    resource: str
    frames: dict[int, F32]


class Case(Protocol):
    """One entry of the catalogue."""

    @property
    def name(self) -> str: ...

    def origin(self) -> str:
        """What draws it, with versions; goldens of another origin are compared with a wider tolerance."""
        ...

    def draw(self, saved: Path) -> list[Picture]:
        """Draw its pictures in stage order; ``saved`` is the folder of its goldens, which may not exist."""
        ...


def half(pixels: F32) -> NDArray[np.float16]:
    """Pixels as stored in a golden; infinities become the largest finite half."""
    return np.clip(pixels, -HALF_MAX, HALF_MAX).astype(np.float16)


@cache
def gl_origin() -> str:
    """GL renderer and version, which includes Mesa's."""
    with closing(Device()) as device:
        return f"{device.renderer}, OpenGL {device.version}"
