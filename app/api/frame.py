"""A picture as arrays."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.api.checked import check_path
from app.arrays import Bytes
from app.errors import SettingsError, did_you_mean
from app.io.aov_preview import LABELS, preview
from app.io.exr_header import picture_header
from app.io.image import exr_layer, write_exr, write_png
from app.scene import Camera
from app.scene import Scene as SceneData


@dataclass(frozen=True, eq=False, repr=False)
class Frame(Mapping[str, NDArray[Any]]):
    """Images by name: ``frame["final"]``; ``list(frame)`` gives the names.

    Arrays are writable, C-contiguous, have their top row first, and support ``__dlpack__``: ``torch.from_dlpack``
    shares their memory.

    Attributes
    ----------
    images : dict of str to ndarray, float32, shape (H, W, C)
        Linear; see the table of AOVs for units and spaces. ``instance`` and ``material`` are int32.
    display : ndarray, uint8, shape (H, W, 3)
        The tone-mapped picture, or without ``final`` a preview of the first image.
    camera : Camera
    scene : app.scene.Scene
        As it was drawn.
    time : float
        Seconds.
    """

    images: dict[str, NDArray[Any]]
    display: Bytes
    camera: Camera
    scene: SceneData
    time: float = 0.0

    def __repr__(self) -> str:
        return f"Frame({', '.join(self.images)}; {self.size[0]}x{self.size[1]})"

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self.images:
            raise SettingsError(f"the frame has no image {name!r}", "frame", did_you_mean(name, self.images))
        return self.images[name]

    __eq__ = object.__eq__      # that of mappings would compare arrays
    __hash__ = object.__hash__

    def __contains__(self, name: object) -> bool:
        return name in self.images

    def __iter__(self) -> Iterator[str]:
        return iter(self.images)

    def __len__(self) -> int:
        return len(self.images)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        height, width = self.display.shape[:2]
        return width, height

    @property
    def instances(self) -> tuple[str, ...]:
        """Names of the ids in ``instance``: id 1 has the first one. Parts of an object with one name share it."""
        return tuple(instance.name for instance in self.scene.instances)

    @property
    def materials(self) -> tuple[str, ...]:
        """Names of the ids in ``material``: id 1 has the first one."""
        return tuple(material.name for material in self.scene.materials)

    def save(self, path: str | Path) -> None:
        """Write the images into an ``.exr`` file, or ``display`` into a ``.png`` file.

        Raises
        ------
        AfterglowError
            When the file can't be written, or has another suffix.
        """
        file = check_path(path, "picture")
        if file.suffix.lower() == ".exr":
            write_exr(file, {"" if name == "final" else name: exr_layer(name, image)
                             for name, image in self.images.items()},
                      header=picture_header(self.scene, self.camera, self.size, self.images))
        elif file.suffix.lower() == ".png":
            write_png(file, self.display)
        else:
            raise SettingsError(f"unknown kind of picture {file.suffix!r}", file, "expected .exr or .png")

    def _repr_png_(self) -> bytes:
        """The picture as notebooks show it."""
        from PIL import Image

        buffer = io.BytesIO()
        Image.fromarray(self.display).save(buffer, "png")
        return buffer.getvalue()


def make_frame(images: dict[str, NDArray[Any]], exposure: float, camera: Camera, scene: SceneData,
               time: float) -> Frame:
    """A frame of what ``app.renderer.Renderer.render`` returns."""
    images = {name: image.astype(np.int32) if name in LABELS else _own(image) for name, image in images.items()}
    display = images.pop("display", None)
    if display is None:
        name, image = next(iter(images.items()))
        display = preview(name, image, exposure)
    return Frame(images, display, camera, scene, time)


def _own(image: NDArray[Any]) -> NDArray[Any]:
    """A writable array in the usual order of memory."""
    return image if image.flags.c_contiguous and image.flags.writeable else image.copy(order="C")
