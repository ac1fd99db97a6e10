"""Training examples, rendered once and stored as memory-mapped half floats."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import torch
from numpy.lib.format import open_memmap
from numpy.typing import NDArray
from torch import Tensor

from app.io.atomic_files import replace_folder
from app.network.contract import ModelContract
from app.network.inputs import MIN_MEAN_RADIANCE
from app.scene import DirectionalLight, RectLight, Scene
from export.dataset.network_inputs import FrameInputs, InputRenderer, PairInputs

if TYPE_CHECKING:
    from export.dataset import Pair, Target

Arrays = dict[str, NDArray[Any]]
Batch = dict[str, Tensor]

VERSION = 4         # of the stored arrays
TARGET_SCALE = 0.5  # targets have half the size of the image, and so have the inputs
CHUNK = 16          # neighbouring pairs for one process, since they often share a scene
DONE = "done"
# Stored names of a target's layers.
LIGHT = {"indirect": "target", "indirect_single": "target_single"}
UNEXPOSED = ("albedo", "reflectance")
SKY = {"diffuse": "target_diffuse", "specular": "target_specular", "albedo": "albedo", "reflectance": "reflectance"}


class Pairs(Protocol):
    """The interface of ``export.dataset.Dataset`` that training needs."""

    folder: Path

    def __len__(self) -> int: ...
    def pair(self, index: int) -> Pair: ...
    def target(self, index: int) -> Target: ...


class Examples:
    """Inputs and targets of a network for every pair of a dataset.

    They are stored in ``DATASET/examples/KEY``, where the key is a hash of everything that they depend on. Networks for
    one bounce and for all bounces share them.

    Parameters
    ----------
    previous : bool
        Whether to include the previous frames, which doubles the rendering time.

    Attributes
    ----------
    missing : list of int
        Pairs that are not rendered yet; see ``render_missing``.
    """

    def __init__(self, pairs: Pairs, contract: ModelContract, previous: bool = True) -> None:
        self.contract, self.previous = replace(contract, scale=TARGET_SCALE), previous
        self.folder = _folder(pairs, self.contract, previous)
        layout = _layout(self.contract, pairs.pair(0).current.size, previous)
        if not self.folder.exists():
            with replace_folder(self.folder) as folder:
                for name, (kind, shape) in layout.items():
                    open_memmap(folder / f"{name}.npy", "w+", kind, (len(pairs), *shape)).flush()
        self._arrays: Arrays = {name: open_memmap(self.folder / f"{name}.npy", "r+") for name in layout}

    def __len__(self) -> int:
        return len(self._arrays[DONE])

    @property
    def missing(self) -> list[int]:
        return [int(i) for i in np.flatnonzero(self._arrays[DONE] == 0)]

    def store(self, index: int, inputs: PairInputs | FrameInputs, target: Target) -> None:
        """Store inputs and target of a pair; ``inputs`` is a ``FrameInputs`` if there is no previous frame."""
        values = _values(self.contract, inputs, target)
        assert values.keys() | {DONE} == self._arrays.keys()
        for name, value in values.items():
            self._arrays[name][index] = value
        self._arrays[DONE][index] = 1  # last, so that the pair of a killed process is rendered again

    def batch(self, indices: list[int]) -> Batch:
        """Examples as float32 tensors with a leading batch axis: the inputs of ``_layout``, and the target."""
        targets = _targets(self.contract)
        parts = {name: [name] for name in self._arrays if name not in (DONE, *LIGHT.values(), *SKY.values())}
        parts |= {name: [LIGHT.get(layer) or SKY[layer] for layer in layers] for name, layers in targets.items()}
        return {name: torch.from_numpy(np.stack([np.concatenate([self._arrays[part][i] for part in stored])
                                                 for i in indices]).astype(np.float32))
                for name, stored in parts.items()}


def open_examples(pairs: Pairs, contract: ModelContract, previous: bool) -> Examples:
    """Examples with previous frames if these are required or already complete, otherwise without."""
    if not previous and _folder(pairs, replace(contract, scale=TARGET_SCALE), previous=True).exists():
        both = Examples(pairs, contract)
        if not both.missing:
            return both
    return Examples(pairs, contract, previous)


def render_missing(pairs: Pairs, contract: ModelContract, previous: bool = True,
                   workers: int | None = None) -> Iterator[int]:
    """Render the missing examples in ``workers`` processes, by default one per core; yields their number by chunk."""
    missing = Examples(pairs, contract, previous).missing
    parts = [missing[at:at + CHUNK] for at in range(0, len(missing), CHUNK)]
    workers = min(workers or len(os.sched_getaffinity(0)), len(parts))
    if workers <= 1:
        for part in parts:
            yield _render(pairs, contract, previous, part)
        return
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, spawn, _one_thread) as pool:
        for future in as_completed([pool.submit(_render, pairs, contract, previous, part) for part in parts]):
            yield future.result()


def frame_inputs(batch: Mapping[str, Tensor], frame: str) -> dict[str, Tensor]:
    """The network's inputs for the frame ``current`` or ``previous``, by their names in the contract."""
    return {name.removeprefix(f"{frame}."): x for name, x in batch.items() if name.startswith(f"{frame}.")}


def pairs_up_to_saturation(pairs: Pairs, max_saturation: float) -> list[int] | None:
    """Indices of pairs without a light of higher saturation; None for a limit of 1, since reading all takes minutes."""
    if max_saturation >= 1:
        return None
    return [i for i in range(len(pairs)) if light_saturation(pairs.pair(i).current.scene) <= max_saturation]


def light_saturation(scene: Scene) -> float:
    """1 - smallest / largest component of the scene's most saturated light or emission; 0 without light."""
    colors = [material.emission for material in scene.materials]
    colors += [light.irradiance if isinstance(light, DirectionalLight) else
               light.radiance if isinstance(light, RectLight) else light.intensity for light in scene.lights]
    if scene.environment is not None:
        colors.append(tuple(scene.environment.radiance.mean(axis=(0, 1), dtype=float).tolist()))
    return max((1 - min(color) / max(color) for color in colors if max(color) > 0), default=0.0)


def _layout(contract: ModelContract, size: tuple[int, int], previous: bool) -> dict[str, tuple[type, tuple[int, ...]]]:
    """Type and shape of the arrays of each pair.

    ``current.T`` for each input tensor T, with exposure applied; the target's layers, relative to the exposure of the
    current frame; ``surface_mask``, 0 or 1. With the previous frame: ``previous.T``; ``motion`` in texels;
    ``history_mask``, 0 or 1; ``exposure_ratio``, the previous exposure over the current one.
    """
    grid = contract.screen_size(size)
    h, w = grid[1], grid[0]

    def frame(name: str) -> dict[str, tuple[type, tuple[int, ...]]]:
        return {f"{name}.{t}": (np.float16, spec.shape(grid)) for t, spec in contract.inputs.items()}

    targets = dict.fromkeys(_layers(contract).values(), (np.float16, (3, h, w)))
    current = {**frame("current"), **targets, "surface_mask": (np.uint8, (1, h, w)), DONE: (np.uint8, ())}
    if not previous:
        return current
    return {**current, **frame("previous"), "motion": (np.float16, (2, h, w)), "history_mask": (np.uint8, (1, h, w)),
            "exposure_ratio": (np.float32, (1, 1, 1))}


def _layers(contract: ModelContract) -> dict[str, str]:
    """Stored names of the target's layers."""
    return SKY if contract.shades_environment else LIGHT


def _targets(contract: ModelContract) -> dict[str, list[str]]:
    """The target tensors of a batch, each with the layers that are concatenated in it."""
    if contract.shades_environment:
        return {"target": ["diffuse", "specular"], "reflectance": ["albedo", "reflectance"]}
    return {"target": ["indirect" if contract.bounces == "multi" else "indirect_single"]}


def _values(contract: ModelContract, inputs: PairInputs | FrameInputs, target: Target) -> dict[str, Any]:
    """The arrays of one pair. The surface mask of a black frame is 0, since nothing can be learned from it."""
    current = inputs.current if isinstance(inputs, PairInputs) else inputs
    exposure = max(current.exposure, MIN_MEAN_RADIANCE)
    half = np.finfo(np.float16).max

    def tensors(name: str, frame: FrameInputs) -> dict[str, Any]:
        return {f"{name}.{t}": np.clip(x, -half, half) for t, x in frame.tensors.items()}

    targets = {}
    for layer, stored in _layers(contract).items():
        light = np.moveaxis(target.layers[layer], -1, 0) / (1 if stored in UNEXPOSED else exposure)
        targets[stored] = np.minimum(light, half)
    mask = target.seen & (current.exposure > MIN_MEAN_RADIANCE)
    values = {**tensors("current", current), **targets, "surface_mask": mask}
    if not isinstance(inputs, PairInputs):
        return values
    return {**values, **tensors("previous", inputs.previous), "motion": inputs.motion, "history_mask": inputs.visible,
            "exposure_ratio": inputs.previous.exposure / exposure}


def _folder(pairs: Pairs, contract: ModelContract, previous: bool) -> Path:
    about = pairs.folder / "dataset.json"
    text = about.read_text("utf-8") if about.exists() else ""
    inputs = {t: [spec.channels, spec.grid, spec.size, spec.rays] for t, spec in contract.inputs.items()}
    parts = [VERSION, len(pairs), text, inputs, contract.exposure, contract.scene_extent, contract.cube_axes]
    parts += [] if previous else ["current only"]
    return pairs.folder / "examples" / hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]


def _render(pairs: Pairs, contract: ModelContract, previous: bool, indices: list[int]) -> int:
    examples = Examples(pairs, contract, previous)
    with InputRenderer(examples.contract) as renderer:
        for index in indices:
            pair = pairs.pair(index)
            inputs = renderer.render(pair) if previous else renderer.render_frame(pair.current)
            examples.store(index, inputs, pairs.target(index))
    return len(indices)


def _one_thread() -> None:
    """Software renderers that run in parallel are fastest with one thread each."""
    os.environ["LP_NUM_THREADS"] = "1"
