"""Torch module → ``.onnx`` with its contract inside, checked against torch before it is kept."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import onnx
import onnxruntime as ort
import torch
from numpy.typing import NDArray

from app.atomic import replacing
from app.channels import CHANNELS, SCREEN
from app.contract import KEY, ModelContract, TensorSpec
from app.errors import ModelError
from export.models.surfels import Gather, Radiosity

Arrays = dict[str, NDArray[np.float32]]
Channels = dict[str, NDArray[np.float64]]

OPSET = 17
# Largest difference between torch and onnxruntime, relative to the largest output. Random points make no
# surface, so rounding alone decides what belongs together.
TOLERANCE = {"room": 1e-4, "random": 2e-2}
ODD = (5, 7)
SIZES = ((1, 1), ODD, (48, 64))
MODULES = {"gather": Gather, "radiosity": Radiosity}


def export_network(name: str, folder: Path) -> Path:
    """Write ``folder/NAME.onnx``; the same torch gives the same bytes every time.

    Raises
    ------
    ModelError
        When onnxruntime disagrees with torch or gives a value that is not finite.
    """
    module = MODULES[name]().eval()
    contract = module.contract
    inputs = _random(contract, SIZES[-1], np.random.default_rng(0))
    dynamic = {tensor: {2: "h", 3: "w"} for tensor, spec in (*contract.inputs.items(), *contract.outputs.items())
               if spec.grid == SCREEN}
    path = folder / f"{name}.onnx"
    folder.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary, warnings.catch_warnings():
        # The tracing exporter is deprecated, but alone gives a small graph without further packages.
        warnings.simplefilter("ignore")
        torch.onnx.export(module, _torch(inputs), temporary, dynamo=False, opset_version=OPSET,
                          input_names=list(contract.inputs), output_names=list(contract.outputs),
                          dynamic_axes=dynamic)
        model = onnx.load(temporary)
        _set_contract(model, contract)
        compare(module, model.SerializeToString())
        temporary.write_bytes(model.SerializeToString(deterministic=True))
    return path


def stamp(path: Path, contract: ModelContract) -> None:
    """Put a contract into an existing ``.onnx`` file, in place of any other.

    Raises
    ------
    ModelError
        When the file is no ONNX model.
    """
    try:
        model = onnx.load(path)
    except Exception as error:  # protobuf's errors share no public base class
        raise ModelError(f"can't read the network ({type(error).__name__})", path, "expected an .onnx file") from None
    _set_contract(model, contract)
    with replacing(path) as temporary:
        temporary.write_bytes(model.SerializeToString(deterministic=True))


def compare(module: torch.nn.Module, model: bytes) -> None:
    """Run torch and onnxruntime on real-like, random and broken inputs.

    Raises
    ------
    ModelError
        When they differ by more than ``TOLERANCE``, or an output is not finite.
    """
    contract: ModelContract = module.contract  # type: ignore[assignment]
    session = ort.InferenceSession(model, providers=["CPUExecutionProvider"])
    for label, inputs in cases(contract):
        with torch.no_grad():
            truth = module(*_torch(inputs)).numpy()
        found = session.run(list(contract.outputs), inputs)[0]
        if not (np.isfinite(found).all() and np.isfinite(truth).all()):
            raise ModelError(f"the output is not finite for {label} inputs", contract.name, "expected finite numbers")
        difference = float(np.abs(found - truth).max() / max(np.abs(truth).max(), 1e-6))
        if difference > TOLERANCE.get(label, np.inf):
            raise ModelError(f"onnxruntime differs from torch by {difference:.2g} for {label} inputs", contract.name,
                             f"expected at most {TOLERANCE[label]}")


def cases(contract: ModelContract) -> Iterator[tuple[str, Arrays]]:
    """Labelled inputs of several sizes; those with a label outside ``TOLERANCE`` only have to stay numbers."""
    rng = np.random.default_rng(1)
    for size in SIZES:
        yield "room", _tensors(contract, size, rng, _room)
        yield "random", _random(contract, size, rng)
    for value in (0.0, np.nan, np.inf, -np.inf, -100.0, 1e6):
        random = _random(contract, ODD, rng)
        yield f"{value}", {t: np.full_like(x, value) for t, x in random.items()}
        yield f"some {value}", {t: np.where(rng.random(x.shape) < 0.1, np.float32(value), x)
                                for t, x in random.items()}


def _random(contract: ModelContract, size: tuple[int, int], rng: np.random.Generator) -> Arrays:
    return _tensors(contract, size, rng, lambda spec, grid, rng: {})


def _tensors(contract: ModelContract, size: tuple[int, int], rng: np.random.Generator,
             known: Callable[[TensorSpec, tuple[int, ...], np.random.Generator], Channels]) -> Arrays:
    """All inputs; channels that ``known`` does not give are uniform noise within their range."""
    tensors = {}
    for tensor, spec in contract.inputs.items():
        grid = size if spec.grid == SCREEN else (6, spec.size or 0, spec.size or 0)
        given = known(spec, grid, rng)
        tensors[tensor] = np.concatenate([given.get(name, _noise(name, grid, rng)) for name in spec.channels])
    return {tensor: x[None].astype(np.float32) for tensor, x in tensors.items()}


def _room(spec: TensorSpec, grid: tuple[int, ...], rng: np.random.Generator) -> Channels:
    """A sphere of radius 20 seen from 3 off its middle: what a network may meet, without a renderer."""
    x, y = np.meshgrid(*((2 * np.arange(n) + 1) / n - 1 for n in (grid[-1], grid[-2])))
    front = np.stack([x, -y, -np.ones_like(x)])
    turned = [front[[0, 1, 2]], front * [[[-1]], [[1]], [[-1]]], front[[2, 1, 0]], front[[2, 1, 0]] * -1,
              front[[0, 2, 1]] * -1, front[[0, 2, 1]]]
    rays = front if spec.grid == SCREEN else np.stack(turned, axis=1)
    length = np.linalg.norm(rays, axis=0)
    rays = rays / length
    middle = np.array([1.0, 2.0, 2.0]).reshape(3, *[1] * (rays.ndim - 1))
    along = (rays * middle).sum(axis=0)
    points = rays * (along + np.sqrt(along ** 2 + 20.0 ** 2 - 9.0))
    normals = (middle - points) / 20.0
    return {"position.view.xyz": points, "normal.view.xyz": normals, "normal.world.xyz": normals,
            "depth": -points[2:], "solid_angle": (4 / (grid[-1] * grid[-2]) / length ** 3)[None],
            "radiance.rgb": 1 + normals, "direct.rgb": 1 + normals}


def _noise(name: str, grid: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float64]:
    channel = CHANNELS[name]
    low, high = max(channel.range[0], -20.0), min(channel.range[1], 20.0)
    if name == "solid_angle":
        high = 4 * np.pi / float(np.prod(grid))
    noise = rng.uniform(low, high, (channel.components, *grid))
    return noise / np.linalg.norm(noise, axis=0) if name.startswith("normal") else noise


def _torch(inputs: Arrays) -> tuple[torch.Tensor, ...]:
    return tuple(torch.from_numpy(x) for x in inputs.values())


def _set_contract(model: onnx.ModelProto, contract: ModelContract) -> None:
    kept = {p.key: p.value for p in model.metadata_props} | {KEY: contract.to_json()}
    onnx.helper.set_model_props(model, kept)
