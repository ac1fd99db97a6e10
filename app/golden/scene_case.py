"""A scene and a camera's way through it: one picture for everything that its passes write."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.golden.case import F32, Picture
from app.golden.origin import gl_origin
from app.golden.scenes import FRAME_SECONDS
from app.graph import Buf
from app.network.contract import Model
from app.renderer import Renderer
from app.scene import Camera, Scene
from app.settings import Settings

OUTPUTS = ("final", "position")  # what makes every pass run
MAX_TEXELS = 2**16              # of a golden; larger ones, such as shadow atlases, are thinned to it


@dataclass(frozen=True)
class Shot:
    """``frames`` frames of a camera of the scene, 1/30 s apart."""

    camera: str
    frames: int


@dataclass(frozen=True, eq=False)
class SceneCase:
    """A scene to draw.

    Attributes
    ----------
    model : path, ``ssgi`` or None
        What makes the indirect light.
    shots : tuple of Shot
        One after the other, with a cut between two; the scene's time runs on.
    kept : tuple of int
        Frames that become goldens, counted from 1 over all shots.
    size : tuple of int
        Width and height in pixels.
    stages : tuple of str or None
        Passes that goldens are kept of; None for all.
    """

    name: str
    scene: Scene
    model: Model | None
    shots: tuple[Shot, ...]
    kept: tuple[int, ...]
    size: tuple[int, int] = (256, 192)
    taa: bool = True
    seed: int = 0
    stages: tuple[str, ...] | None = None

    def origin(self) -> str:
        """GL renderer and version."""
        return gl_origin()

    def renderer(self) -> Renderer:
        """A new renderer for the case."""
        settings = Settings(size=self.size, outputs=OUTPUTS, taa=self.taa, provider="cpu", seed=self.seed)
        return Renderer(self.scene, settings, self.model)

    def draw(self, saved: Path) -> list[Picture]:
        """Every resource of the kept stages, large ones thinned; ``saved`` plays no part."""
        with self.renderer() as renderer:
            pictures = [Picture(p.name, w, {}) for p in renderer.plan.passes for w in p.writes
                        if self.stages is None or p.name in self.stages]
            for number, (camera, cut) in enumerate(self._frames(), 1):
                if cut:
                    renderer.cut()
                renderer.advance(camera, (number - 1) * FRAME_SECONDS)
                if number in self.kept:
                    for picture in pictures:
                        picture.frames[number] = _thinned(_image(renderer, picture.resource))
            return pictures

    def first_tensors(self) -> dict[str, F32]:
        """What the first frame feeds the network: each input tensor's resource, its planes one below the other."""
        with self.renderer() as renderer:
            renderer.advance(next(self._frames())[0])
            return {name: _image(renderer, name) for name, r in renderer.plan.resources.items() if isinstance(r, Buf)}

    def _frames(self) -> Iterator[tuple[Camera, bool]]:
        """The camera of each frame, and whether a cut comes before it."""
        number = 0
        for shot in self.shots:
            path = self.scene.cameras[shot.camera]
            for n in range(shot.frames):
                yield path.at(number * FRAME_SECONDS), number > 0 and n == 0
                number += 1


def _image(renderer: Renderer, resource: str) -> F32:
    """A resource as [H, W, 1 to 4]; a tensor's planes lie one below the other, 8 bits span 0 to 1."""
    pixels = renderer.resource(resource)
    image = pixels.astype(np.float32) / np.float32(255 if pixels.dtype == np.uint8 else 1)
    return image.reshape(-1, image.shape[-1], 1) if isinstance(renderer.plan.resources[resource], Buf) else image


def _thinned(image: F32) -> F32:
    """Every n-th row and column, n as small as ``MAX_TEXELS`` allows."""
    step = max(1, math.ceil(math.sqrt(image.shape[0] * image.shape[1] / MAX_TEXELS)))
    return np.ascontiguousarray(image[::step, ::step])
