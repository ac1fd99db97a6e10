"""The scene that most hard cases start from, and how to compare pictures of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from app.network.selection import find_model
from app.scene import Camera, Light, PointLight, Scene
from tests.gl.scenes import Images, Part, box, draw, floor, make_scene, quad

SIZE = (61, 47)  # odd both ways
CAMERA = Camera((0.2, 1.2, 2.5), (0.0, 0.4, 0.0))
LAMP = PointLight((0.5, 1.5, 0.8), (1.0, 0.9, 0.7), 0.05)
HARD_LAMP = PointLight((0.5, 1.5, 0.8), (1.0, 0.9, 0.7))
RADIOSITY = find_model("radiosity")
EVERYTHING = ("final", "direct", "indirect", "albedo", "normal", "depth")


def corner() -> list[Part]:
    """A floor, a wall behind, and a box before it; sky above and beside."""
    return [floor(1.5), quad((-1.5, 0.0, -1.5), (3.0, 0, 0), (0, 1.0, 0)), box((-0.3, 0.0, -0.2), (0.5, 0.6, 0.4))]


def lit_corner(*lights: Light, more: tuple[Part, ...] = ()) -> Scene:
    return make_scene([*corner(), *more], lights or (LAMP,), CAMERA)


def shown(scene: Scene, outputs: tuple[str, ...] = EVERYTHING, size: tuple[int, int] = SIZE) -> Images:
    """One frame with multi-bounce indirect light."""
    return draw(scene, size, outputs, model=RADIOSITY)


def assert_same(found: Images, expected: Images) -> None:
    """Bit for bit."""
    for name, image in expected.items():
        np.testing.assert_array_equal(found[name], image, name)


def beyond(found: NDArray[np.float32], expected: NDArray[np.float32], tolerance: float) -> float:
    """Share of the values that differ by more than ``tolerance`` of the largest expected one."""
    return float(np.mean(np.abs(found.astype(np.float64) - expected) > tolerance * np.abs(expected).max()))
