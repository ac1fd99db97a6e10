"""A synthetic dataset: the embedded Cornell box, a camera that moves slightly, and analytic targets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from app.load import embedded_scene
from app.scene import Scene
from export.dataset.target import nearest_texels
from export.reference.still import Still


@dataclass(frozen=True)
class Pair:
    previous: Still
    current: Still


@dataclass(frozen=True)
class Target:
    layers: dict[str, np.ndarray]
    seen: np.ndarray


@dataclass
class CornellPairs:
    """``count`` pairs whose targets are the same smooth function of the position on the screen."""

    folder: Path
    count: int
    size: tuple[int, int] = (64, 48)

    @cached_property
    def scene(self) -> Scene:
        return embedded_scene()

    def __len__(self) -> int:
        return self.count

    def pair(self, index: int) -> Pair:
        camera = self.scene.cameras[self.scene.default_camera].at(0.0)
        rng = np.random.default_rng(index)
        before = np.asarray(camera.eye) + 0.1 * self.scene.longest_edge * rng.uniform(-1, 1, 3)
        eyes = before, before + 0.01 * self.scene.longest_edge
        return Pair(*(Still(self.scene, replace(camera, eye=tuple(eye)), self.size) for eye in eyes))

    def target(self, index: int) -> Target:
        rows, columns = nearest_texels(self.size, (self.size[0] // 2, self.size[1] // 2))
        x, y = np.meshgrid(columns / self.size[0], rows / self.size[1])
        light = 0.1 * np.stack([1 + x, 1 + y, 2 - x], axis=-1).astype(np.float32)
        return Target({"indirect": light, "indirect_single": 0.5 * light}, np.ones(light.shape[:2], bool))
