"""Torch module → ``.onnx`` with its contract inside, checked against torch before it is kept."""

from __future__ import annotations

import io
import warnings
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

OPSET = 17
TOLERANCE = 1e-2  # largest difference between torch and onnxruntime, relative to the largest output
SIZES = ((1, 1), (5, 7), (48, 64))
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
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        # The tracing exporter is deprecated, but alone gives a small graph without further packages.
        warnings.simplefilter("ignore")
        torch.onnx.export(module, _torch(inputs), buffer, dynamo=False, opset_version=OPSET,
                          input_names=list(contract.inputs), output_names=list(contract.outputs),
                          dynamic_axes=dynamic)
    model = onnx.load_from_string(buffer.getvalue())
    _set_contract(model, contract)
    compare(module, model.SerializeToString())
    path = folder / f"{name}.onnx"
    _save(model, path)
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
    _save(model, path)


def compare(module: torch.nn.Module, model: bytes) -> float:
    """Largest relative difference between torch and onnxruntime on random, small and broken inputs.

    Raises
    ------
    ModelError
        When it is above ``TOLERANCE``, or an output is not finite.
    """
    contract: ModelContract = module.contract  # type: ignore[assignment]
    session = ort.InferenceSession(model, providers=["CPUExecutionProvider"])
    worst = 0.0
    for label, inputs in _cases(contract):
        with torch.no_grad():
            truth = module(*_torch(inputs)).numpy()
        found = session.run(list(contract.outputs), inputs)[0]
        if not (np.isfinite(found).all() and np.isfinite(truth).all()):
            raise ModelError(f"the output is not finite for {label} inputs", contract.name, "expected finite numbers")
        difference = float(np.abs(found - truth).max() / max(np.abs(truth).max(), 1e-6))
        # Broken inputs only have to stay numbers: there rounding decides which branch is taken.
        if label in ("random", "zero") and difference > TOLERANCE:
            raise ModelError(f"onnxruntime differs from torch by {difference:.2g} for {label} inputs", contract.name,
                             f"expected at most {TOLERANCE}")
        worst = max(worst, difference if label == "random" else 0.0)
    return worst


def _cases(contract: ModelContract) -> list[tuple[str, Arrays]]:
    cases = []
    for size in SIZES:
        random = _random(contract, size, np.random.default_rng(1))
        cases.append(("random", random))
        for label, value in (("zero", 0.0), ("NaN", np.nan), ("+Inf", np.inf), ("-Inf", -np.inf), ("-100", -100.0),
                             ("1e6", 1e6)):
            cases.append((label, {t: np.full_like(x, value) for t, x in random.items()}))
            mixed = np.random.default_rng(2)
            cases.append((f"some {label}", {
                t: np.where(mixed.random(x.shape) < 0.1, np.float32(value), x) for t, x in random.items()}))
    return cases


def _random(contract: ModelContract, size: tuple[int, int], rng: np.random.Generator) -> Arrays:
    return {tensor: _random_tensor(spec, size, rng) for tensor, spec in contract.inputs.items()}


def _random_tensor(spec: TensorSpec, size: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float32]:
    grid = size if spec.grid == SCREEN else (6, spec.size, spec.size)
    parts = []
    for name in spec.channels:
        channel = CHANNELS[name]
        low, high = max(channel.range[0], -20.0), min(channel.range[1], 20.0)
        if name == "solid_angle":
            high = 4 * np.pi / np.prod(grid)
        part = rng.uniform(low, high, (1, channel.components, *grid))
        parts.append(part / np.linalg.norm(part, axis=1, keepdims=True) if name.startswith("normal") else part)
    return np.concatenate(parts, axis=1).astype(np.float32)


def _torch(inputs: Arrays) -> tuple[torch.Tensor, ...]:
    return tuple(torch.from_numpy(x) for x in inputs.values())


def _set_contract(model: onnx.ModelProto, contract: ModelContract) -> None:
    kept = {p.key: p.value for p in model.metadata_props} | {KEY: contract.to_json()}
    onnx.helper.set_model_props(model, kept)


def _save(model: onnx.ModelProto, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        temporary.write_bytes(model.SerializeToString(deterministic=True))
