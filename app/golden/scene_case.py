"""A scene and camera shots in it: one picture per resource that its passes write."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.arrays import F32
from app.exchange.selection import OpenExchange, open_exchange
from app.golden.case import Picture, gl_origin
from app.golden.scenes import FRAME_SECONDS
from app.graph import Buf
from app.network.selection import Model
from app.renderer import Renderer
from app.scene import Camera, Scene
from app.settings import TONE_MAPS, Settings

OUTPUTS = ("final", "position")  # all passes but ``labels`` and ``reflection`` run for these
MAX_TEXELS = 2**16               # of a golden; larger images, such as shadow atlases, are subsampled


@dataclass(frozen=True)
class Shot:
    """``frames`` frames by a camera of the scene, 1/30 s apart."""

    camera: str
    frames: int


@dataclass(frozen=True, eq=False)
class SceneCase:
    """A scene, and how it is drawn.

    Attributes
    ----------
    model : path, ``ssgi`` or None
        Model for indirect light, or one that shades an environment.
    shots : tuple of Shot
        Consecutive shots with a cut between them; the scene's time continues.
    golden_frames : tuple of int
        Numbers of the frames that become goldens, counted from 1 over all shots.
    size : tuple of int
        Width and height in pixels.
    stages : tuple of str or None
        Passes whose output becomes goldens; None for all.
    outputs : tuple of str
        What the passes run for.
    tonemap, auto_exposure, render_scale, rays
        As in ``Settings``.
    open_exchange : callable
        As for ``Renderer``.
    """

    name: str
    scene: Scene
    model: Model | None
    shots: tuple[Shot, ...]
    golden_frames: tuple[int, ...]
    size: tuple[int, int] = (256, 192)
    taa: bool = True
    reflections: bool = False
    seed: int = 0
    stages: tuple[str, ...] | None = None
    outputs: tuple[str, ...] = OUTPUTS
    tonemap: str = TONE_MAPS[0]
    auto_exposure: bool = False
    render_scale: float = 1.0
    rays: str = "cpu"
    open_exchange: OpenExchange = open_exchange

    def origin(self) -> str:
        """GL renderer and version."""
        return gl_origin()

    def renderer(self) -> Renderer:
        """A new renderer for the case."""
        settings = Settings(size=self.size, outputs=self.outputs, taa=self.taa, reflections=self.reflections,
                            tonemap=self.tonemap, auto_exposure=self.auto_exposure, provider="cpu", seed=self.seed,
                            render_scale=self.render_scale, rays=self.rays)
        return Renderer(self.scene, settings, self.model, self.open_exchange)

    def draw(self, saved: Path) -> list[Picture]:
        """Every resource of the stages, large ones subsampled; ``saved`` is not used."""
        with self.renderer() as renderer:
            pictures = [Picture(p.name, w, {}) for p in renderer.plan.passes for w in p.writes
                        if self.stages is None or p.name in self.stages]
            for number, (camera, cut) in enumerate(self._frames(), 1):
                if cut:
                    renderer.cut()
                renderer.advance(camera, (number - 1) * FRAME_SECONDS, following=(camera, number * FRAME_SECONDS))
                if number in self.golden_frames:
                    for picture in pictures:
                        picture.frames[number] = _subsample(_image(renderer, picture.resource))
            return pictures

    def first_tensors(self) -> dict[str, F32]:
        """The network's input tensors in the first frame by resource name, their planes stacked vertically."""
        with self.renderer() as renderer:
            renderer.advance(next(self._frames())[0])
            return {name: _image(renderer, name) for name, r in renderer.plan.resources.items() if isinstance(r, Buf)}

    def _frames(self) -> Iterator[tuple[Camera, bool]]:
        """The camera of each frame, and whether it follows a cut."""
        number = 0
        for shot in self.shots:
            path = self.scene.cameras[shot.camera]
            for n in range(shot.frames):
                yield path.at(number * FRAME_SECONDS), number > 0 and n == 0
                number += 1


def _image(renderer: Renderer, resource: str) -> F32:
    """A resource, shape (H, W, 1 to 4); planes of a tensor are stacked vertically, 8-bit values map to 0…1."""
    pixels = renderer.resource(resource)
    image = pixels.astype(np.float32) / np.float32(255 if pixels.dtype == np.uint8 else 1)
    return image.reshape(-1, image.shape[-1], 1) if isinstance(renderer.plan.resources[resource], Buf) else image


def _subsample(image: F32) -> F32:
    """Every n-th row and column, with the smallest n that ``MAX_TEXELS`` allows."""
    step = max(1, math.ceil(math.sqrt(image.shape[0] * image.shape[1] / MAX_TEXELS)))
    return np.ascontiguousarray(image[::step, ::step])
