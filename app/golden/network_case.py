"""A network on saved tensors, so that its goldens don't move with the rasteriser."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.errors import SceneError
from app.golden.case import F32, Picture, half
from app.golden.origin import network_origin
from app.golden.scene_case import SceneCase
from app.golden.store import file_name
from app.io.image import read_exr
from app.network.contract import read_contract
from app.network.session import Network
from app.passes.pack_screen import tensor_names

FRAME = 1
LAYER = f"frame{FRAME}"


@dataclass(frozen=True, eq=False)
class NetworkCase:
    """The network of a scene case, run once on the tensors of that case's first frame.

    The tensors are goldens themselves: drawn once, when there are none yet, and read from then on.
    """

    source: SceneCase
    model: Path

    @property
    def name(self) -> str:
        return f"{self.source.name}.network"

    def origin(self) -> str:
        """Version of onnxruntime and execution provider."""
        return network_origin()

    def draw(self, saved: Path) -> list[Picture]:
        """The saved tensors, then what the network makes of them, [h, w, 3].

        Raises
        ------
        SceneError
            When a saved tensor has not the shape that the network's contract asks for.
        """
        contract = read_contract(self.model)
        size = contract.screen_size(self.source.size)
        names = tensor_names(contract)
        paths = {t: saved / file_name(name) for t, name in names.items()}
        if all(path.exists() for path in paths.values()):
            images = {t: _read(path) for t, path in paths.items()}
        else:
            drawn = self.source.first_tensors()
            images = {t: half(drawn[name]).astype(np.float32) for t, name in names.items()}
        tensors = {t: _tensor(images[t], spec.shape(size), paths[t]) for t, spec in contract.inputs.items()}
        made = Network(self.model, size, "cpu").run(tensors)
        return [*(Picture("saved tensors", names[t], {FRAME: image}) for t, image in images.items()),
                *(Picture("network", channel.removesuffix(".rgb"), {FRAME: np.moveaxis(planes, 0, -1)})
                  for channel, planes in made.items())]


def _read(path: Path) -> F32:
    layers = read_exr(path)
    if LAYER not in layers:
        raise SceneError(f"no layer {LAYER!r} in the saved tensor", path, "expected a tensor that golden update saved")
    return layers[LAYER]


def _tensor(image: F32, shape: tuple[int, ...], path: Path) -> F32:
    """A tensor of the given shape from planes one below the other."""
    if image.shape != (int(np.prod(shape[:-1])), shape[-1], 1):
        raise SceneError(f"a saved tensor of {image.shape[0]} rows of {image.shape[1]}", path,
                         f"expected {list(shape)}; delete the file, and golden update saves a new one")
    return np.ascontiguousarray(image).reshape(shape)
