"""A network on saved tensors, so that its goldens do not depend on the rasteriser."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnxruntime

from app.arrays import F32
from app.errors import SceneError
from app.golden.case import Picture, half
from app.golden.scene_case import SceneCase
from app.golden.store import file_name, read_picture
from app.network.contract_json import read_contract
from app.network.session import Network
from app.passes.pack_screen import tensor_names

FRAME = 1


@dataclass(frozen=True, eq=False)
class NetworkCase:
    """The network of a scene case, run once on the tensors of that case's first frame.

    The tensors are goldens too: drawn by the first update and read from then on.
    """

    source: SceneCase
    model: Path

    @property
    def name(self) -> str:
        return f"{self.source.name}.network"

    def origin(self) -> str:
        """Version of onnxruntime and execution provider."""
        return f"onnxruntime {onnxruntime.__version__}, cpu"

    def draw(self, saved: Path) -> list[Picture]:
        """The saved tensors, then the network's outputs, shape (h, w, 3); those at surfels are one row.

        Raises
        ------
        SceneError
            When a saved tensor can't be read, or has no first frame or not the shape of the network's contract.
        """
        contract = read_contract(self.model)
        size = contract.screen_size(self.source.size)
        names = tensor_names(contract)
        read = {t: _read(saved, name) for t, name in names.items()}
        images = {t: image for t, image in read.items() if image is not None}
        if len(images) < len(names):
            first_frame = self.source.first_tensors()
            images = {t: half(first_frame[name]).astype(np.float32) for t, name in names.items()}
        tensors = {t: _tensor(images[t], spec.shape(size), saved / file_name(names[t]))
                   for t, spec in contract.inputs.items()}
        outputs = Network(self.model, size, "cpu").run(tensors)
        return [*(Picture("saved tensors", names[t], {FRAME: image}) for t, image in images.items()),
                *(Picture("network", channel.removesuffix(".rgb"), {FRAME: _image(planes)})
                  for channel, planes in outputs.items())]


def _image(planes: F32) -> F32:
    """An output, shape (C, h, w) or (C, S), as an image with its channels last."""
    return np.moveaxis(planes.reshape(len(planes), -1, planes.shape[-1]), 0, -1)


def _read(saved: Path, name: str) -> F32 | None:
    """A saved tensor; None if there is none."""
    frames = read_picture(saved, name)
    if frames is not None and FRAME not in frames:
        raise SceneError(f"no layer 'frame{FRAME}' in the saved tensor", saved / file_name(name),
                         "expected a tensor that golden update saved; delete the file and it saves a new one")
    return None if frames is None else frames[FRAME]


def _tensor(image: F32, shape: tuple[int, ...], path: Path) -> F32:
    """A tensor of the given shape from its planes stacked vertically."""
    if image.shape != (int(np.prod(shape[:-1])), shape[-1], 1):
        raise SceneError(f"the saved tensor has {image.shape[0]} rows of {image.shape[1]}", path,
                         f"expected shape {list(shape)}; delete the file and golden update saves a new one")
    return np.ascontiguousarray(image).reshape(shape)
