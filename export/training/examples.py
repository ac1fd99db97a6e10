"""Examples drawn once and kept: memory-mapped half floats, so that epochs don't draw again."""

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

from app.io.atomic_files import replacing_folder
from app.network.contract import ModelContract
from app.network.session import FLOOR
from export.dataset.network_inputs import Drawer, Frame, Inputs

if TYPE_CHECKING:
    from export.dataset import Pair, Target

Arrays = dict[str, NDArray[Any]]
Batch = dict[str, Tensor]

VERSION = 3         # of what is kept
TARGET_SCALE = 0.5  # targets lie on the grid of half the image, so that is what inputs are drawn for
AT_ONCE = 16        # neighbours that one process draws, as they often share a scene
DONE = "done"
# What is kept of a target's layers, by their names.
LIGHT = {"indirect": "target", "indirect_single": "target_single"}
RATIOS = ("albedo", "reflectance")  # that no exposure applies to
SKY = {"diffuse": "target_diffuse", "specular": "target_specular", "albedo": "albedo", "reflectance": "reflectance"}


class Pairs(Protocol):
    """What training needs of a dataset: ``export.dataset.Dataset``, or a stand-in."""

    folder: Path

    def __len__(self) -> int: ...
    def pair(self, index: int) -> Pair: ...
    def target(self, index: int) -> Target: ...


class Examples:
    """What a network is given and what it is to find, for every pair of a dataset.

    They are kept in ``DATASET/drawn/KEY``; the key holds what they depend on. Networks for one bounce and for all share
    them.

    Parameters
    ----------
    previous : bool
        Whether with the frames before, which take as long to draw again.

    Attributes
    ----------
    missing : list of int
        Pairs that are not drawn yet; see ``draw_missing``.
    """

    def __init__(self, pairs: Pairs, contract: ModelContract, previous: bool = True) -> None:
        self.contract, self.previous = replace(contract, scale=TARGET_SCALE), previous
        self.folder = _folder(pairs, self.contract, previous)
        layout = _layout(self.contract, pairs.pair(0).current.size, previous)
        if not self.folder.exists():
            with replacing_folder(self.folder) as fresh:
                for name, (kind, shape) in layout.items():
                    open_memmap(fresh / f"{name}.npy", "w+", kind, (len(pairs), *shape)).flush()
        self._arrays: Arrays = {name: open_memmap(self.folder / f"{name}.npy", "r+") for name in layout}

    def __len__(self) -> int:
        return len(self._arrays[DONE])

    @property
    def missing(self) -> list[int]:
        return [int(i) for i in np.flatnonzero(self._arrays[DONE] == 0)]

    def put(self, index: int, inputs: Inputs | Frame, target: Target) -> None:
        """Keep what was drawn and traced for a pair; inputs of the current frame alone without ``previous``."""
        values = _values(self.contract, inputs, target)
        assert values.keys() | {DONE} == self._arrays.keys()
        for name, value in values.items():
            self._arrays[name][index] = value
        self._arrays[DONE][index] = 1  # last: a process killed before leaves it to be drawn again

    def batch(self, indices: list[int]) -> Batch:
        """Examples, float32, each tensor with the batch first: what ``_layout`` names, with the contract's target."""
        targets = _targets(self.contract)
        wanted = {name: [name] for name in self._arrays if name not in (DONE, *LIGHT.values(), *SKY.values())}
        wanted |= {name: [LIGHT.get(part) or SKY[part] for part in parts] for name, parts in targets.items()}
        return {name: torch.from_numpy(np.stack([np.concatenate([self._arrays[k][i] for k in kept])
                                                 for i in indices]).astype(np.float32))
                for name, kept in wanted.items()}


def examples_for(pairs: Pairs, contract: ModelContract, previous: bool) -> Examples:
    """Those with the frames before where these are wanted or, all of them, kept already; others without."""
    if not previous and _folder(pairs, replace(contract, scale=TARGET_SCALE), previous=True).exists():
        both = Examples(pairs, contract)
        if not both.missing:
            return both
    return Examples(pairs, contract, previous)


def draw_missing(pairs: Pairs, contract: ModelContract, previous: bool = True,
                 workers: int | None = None) -> Iterator[int]:
    """Draw what is missing, in ``workers`` processes or one for each core; yields how many, whenever some are done."""
    missing = Examples(pairs, contract, previous).missing
    parts = [missing[at:at + AT_ONCE] for at in range(0, len(missing), AT_ONCE)]
    workers = min(workers or len(os.sched_getaffinity(0)), len(parts))
    if workers <= 1:
        for part in parts:
            yield _draw(pairs, contract, previous, part)
        return
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, spawn, _one_thread) as pool:
        for future in as_completed([pool.submit(_draw, pairs, contract, previous, part) for part in parts]):
            yield future.result()


def tensors_of(batch: Mapping[str, Tensor], frame: str) -> dict[str, Tensor]:
    """The network's inputs for ``current`` or ``previous``, by their names in the contract."""
    return {name.removeprefix(f"{frame}."): x for name, x in batch.items() if name.startswith(f"{frame}.")}


def _layout(contract: ModelContract, size: tuple[int, int], previous: bool) -> dict[str, tuple[type, tuple[int, ...]]]:
    """What is kept of each pair: type and shape.

    ``current.T`` for each input tensor T, exposed; the target's layers, light in means of the current frame; ``seen``,
    0 or 1. With the previous frame: ``previous.T``; ``motion`` in texels; ``visible``, 0 or 1; ``ratio``, its exposure
    over the current one's.
    """
    grid = contract.screen_size(size)
    h, w = grid[1], grid[0]

    def frame(name: str) -> dict[str, tuple[type, tuple[int, ...]]]:
        return {f"{name}.{t}": (np.float16, spec.shape(grid)) for t, spec in contract.inputs.items()}

    targets = dict.fromkeys(_layers(contract).values(), (np.float16, (3, h, w)))
    current = {**frame("current"), **targets, "seen": (np.uint8, (1, h, w)), DONE: (np.uint8, ())}
    if not previous:
        return current
    return {**current, **frame("previous"), "motion": (np.float16, (2, h, w)), "visible": (np.uint8, (1, h, w)),
            "ratio": (np.float32, (1, 1, 1))}


def _layers(contract: ModelContract) -> dict[str, str]:
    """Layers of a target that are kept for such networks, and under which name."""
    return SKY if contract.shades_environment else LIGHT


def _targets(contract: ModelContract) -> dict[str, list[str]]:
    """What a batch has of a target, and from which layers, one after the other."""
    if contract.shades_environment:
        return {"target": ["diffuse", "specular"], "reflectance": ["albedo", "reflectance"]}
    return {"target": ["indirect" if contract.bounces == "multi" else "indirect_single"]}


def _values(contract: ModelContract, inputs: Inputs | Frame, target: Target) -> dict[str, Any]:
    """What is kept of one pair. A frame that is black to the network teaches nothing, so nothing is seen in it."""
    current = inputs.current if isinstance(inputs, Inputs) else inputs
    exposure = max(current.exposure, FLOOR)
    half = np.finfo(np.float16).max

    def tensors(name: str, frame: Frame) -> dict[str, Any]:
        return {f"{name}.{t}": np.clip(x, -half, half) for t, x in frame.tensors.items()}

    targets = {kept: np.minimum(np.moveaxis(target.layers[name], -1, 0) / (1 if kept in RATIOS else exposure), half)
               for name, kept in _layers(contract).items()}
    values = {**tensors("current", current), **targets, "seen": target.seen & (current.exposure > FLOOR)}
    if not isinstance(inputs, Inputs):
        return values
    return {**values, **tensors("previous", inputs.previous), "motion": inputs.motion, "visible": inputs.visible,
            "ratio": inputs.previous.exposure / exposure}


def _folder(pairs: Pairs, contract: ModelContract, previous: bool) -> Path:
    about = pairs.folder / "dataset.json"
    text = about.read_text("utf-8") if about.exists() else ""
    inputs = {t: [spec.channels, spec.grid, spec.size, spec.rays] for t, spec in contract.inputs.items()}
    parts = [VERSION, len(pairs), text, inputs, contract.exposure, contract.scene_extent, contract.cube_axes]
    parts += [] if previous else ["current alone"]
    return pairs.folder / "drawn" / hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]


def _draw(pairs: Pairs, contract: ModelContract, previous: bool, indices: list[int]) -> int:
    examples = Examples(pairs, contract, previous)
    with Drawer(examples.contract) as drawer:
        for index in indices:
            pair = pairs.pair(index)
            inputs = drawer.draw(pair) if previous else drawer.still(pair.current)
            examples.put(index, inputs, pairs.target(index))
    return len(indices)


def _one_thread() -> None:
    """Several software renderers at once are quickest with one thread each."""
    os.environ["LP_NUM_THREADS"] = "1"
