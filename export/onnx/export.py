"""Exports torch modules with their contracts to ``.onnx`` files, which are written only if they agree with torch."""

import copy
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import onnxruntime as ort
import torch

from app.errors import ModelError
from app.io.atomic_files import prepare_folders, replace_file, write_text
from app.network.contract import KEY, ModelContract
from app.network.contract_json import contract_to_json
from app.network.selection import HALF_SUFFIX
from app.network.static_cache import StaticCache
from export.models import UNTRAINED, Network, bcnn, make_network
from export.models.gather_cleaners import CLEANERS
from export.models.network import outputs_of
from export.models.radiosity import Radiosity
from export.onnx.card import card, summary
from export.onnx.graphs import trace_network
from export.onnx.sample_inputs import Arrays, example_inputs, rendered_inputs, sample_inputs
from export.training.checkpoint import Checkpoint

# Largest difference between torch and onnxruntime, relative to the largest output. Other inputs only have to give
# finite outputs. Random points form no surfaces, so rounding alone decides which surfels belong together.
UNTRAINED_TOLERANCE = {"room": 1e-4, "random": 2e-2}
TRAINED_TOLERANCE = {"float32": 1e-4, "float16": 1e-2}  # for all inputs
SCALING_SURFELS = (128, 256, 512, 768)
SCALING_WIDTHS, SCALING_SCALE = ("bcnn-8", "bcnn-16", "bcnn-32"), 1 / 4  # one part of the image for all widths


def export_network(name: str, folder: Path) -> Path:
    """Write ``folder/NAME.onnx`` for an untrained network; the same version of torch gives the same bytes.

    Raises
    ------
    ModelError
        When onnxruntime disagrees with torch, or an output is not finite.
    """
    network = UNTRAINED[name]().eval()
    return write_network(network, folder, sample_inputs(network.contract), UNTRAINED_TOLERANCE)[0]


def export_checkpoint(checkpoint: Checkpoint, folder: Path,
                      dtypes: Iterable[str] = tuple(TRAINED_TOLERANCE)) -> list[Path]:
    """Write the averaged network as ``NAME.onnx`` and ``NAME-half.onnx``, and their model card ``NAME.md``.

    Raises
    ------
    ModelError
        When onnxruntime differs too much from torch in single precision, or an output is not finite.
    """
    network = checkpoint.network()
    network.contract = replace(network.export_contract(), trained_on=summary(checkpoint))
    rendered = ((f"rendered {name}", tensors) for name, tensors in rendered_inputs(network.contract))
    inputs = [*rendered, *sample_inputs(network.contract)]
    differences = {}
    for dtype in dtypes:
        variant = network if dtype == "float32" else to_half(network)
        tolerance = {label: TRAINED_TOLERANCE[dtype] for label, _ in inputs}
        path, differences[path] = write_network(variant, folder, inputs, tolerance, network)
    write_text(folder / f"{network.contract.name}.md", card(checkpoint, network.contract, differences))
    return list(differences)


def export_cleaner(weights: Path, trained_on: str, folder: Path) -> Path:
    """Write the network of ``python -m export gather train`` as ``NAME.onnx``.

    Raises
    ------
    ModelError
        When the file is none of that command, or onnxruntime disagrees with torch.
    """
    try:
        saved = torch.load(weights, weights_only=True)
        network = CLEANERS[saved["name"]]()
        network.load_state_dict(saved["weights"])
    except Exception as error:  # unpickling what is no file of torch can raise anything
        raise ModelError(f"can't read the weights ({type(error).__name__})", weights,
                         "expected a file of python -m export gather train") from None
    network.contract = replace(network.contract, trained_on=trained_on)
    inputs = list(sample_inputs(network.contract))
    tolerance = {label: TRAINED_TOLERANCE["float32"] for label, _ in inputs}
    return write_network(network.eval(), folder, inputs, tolerance)[0]


def export_scaling_networks(folder: Path) -> list[Path]:
    """Write untrained ``surfels-N.onnx`` and ``width-N.onnx``, whose time is representative and whose light is not.

    N counts surfels, or channels of the first layer.
    """
    networks: dict[str, Network] = {f"surfels-{surfels}": Radiosity(surfels) for surfels in SCALING_SURFELS}
    networks |= {f"width-{bcnn.PRESETS[preset].widths[0]}": make_network(preset) for preset in SCALING_WIDTHS}
    for name, network in networks.items():
        scale = SCALING_SCALE if name.startswith("width") else None
        network.contract = replace(network.contract, name=name).with_scale(scale)
    return [write_network(network.eval(), folder, (), {})[0] for network in networks.values()]


def to_half(network: Network) -> Network:
    """A copy with weights in half precision; operations that cast to single precision keep it."""
    half = copy.deepcopy(network).half()
    half.contract = replace(network.contract, name=f"{network.contract.name}{HALF_SUFFIX}", dtype="float16")
    return half


def write_network(network: Network, folder: Path, inputs: Iterable[tuple[str, Arrays]],
                  tolerance: Mapping[str, float], reference: Network | None = None) -> tuple[Path, float]:
    """Write ``folder/NAME.onnx`` if it agrees with ``reference``, by default the network itself, on ``inputs``.

    Returns
    -------
    path : Path
    difference : float
        As ``compare`` returns it.

    Raises
    ------
    ModelError
        When it does not agree.
    OutputError
        When the folder can't be written to.
    """
    contract = network.contract
    example = _to_torch(example_inputs(contract), contract)
    path = folder / f"{contract.name}.onnx"
    prepare_folders(folder)
    with replace_file(path) as temporary:
        model = trace_network(network, example)
        _set_contract(model, contract)
        difference = compare(reference or network, model.SerializeToString(), contract, inputs, tolerance)
        temporary.write_bytes(model.SerializeToString(deterministic=True))
    return path, difference


def stamp(path: Path, contract: ModelContract) -> None:
    """Store a contract in an existing ``.onnx`` file, replacing any other.

    Raises
    ------
    ModelError
        When the file is not an ONNX model.
    """
    model = load_model(path)
    _set_contract(model, contract)
    with replace_file(path) as temporary:
        temporary.write_bytes(model.SerializeToString(deterministic=True))


def load_model(path: Path) -> onnx.ModelProto:
    """Read an ONNX model.

    Raises
    ------
    ModelError
        When the file is not an ONNX model.
    """
    try:
        return onnx.load(path)
    except Exception as error:  # protobuf's errors have no public base class
        raise ModelError(f"not an ONNX model ({type(error).__name__})", path, "expected an .onnx file") from None


def compare(reference: Network, model: bytes, contract: ModelContract, inputs: Iterable[tuple[str, Arrays]],
            tolerance: Mapping[str, float]) -> float:
    """Run ``reference`` in torch, in single precision, and ``model`` in onnxruntime on labelled ``inputs``.

    Returns
    -------
    float
        The largest difference over all inputs whose label has a tolerance, relative to the largest output.

    Raises
    ------
    ModelError
        When a difference exceeds its tolerance, or an output is not finite.
    """
    session = ort.InferenceSession(model, providers=["CPUExecutionProvider"])
    cache = StaticCache(session, contract.static_input).feeds({})
    largest = 0.0
    for label, tensors in inputs:
        with np.errstate(over="ignore"):
            feeds = {t: x.astype(contract.dtype) for t, x in tensors.items()}
        with torch.no_grad():
            expected = outputs_of(reference(*_to_torch(feeds, reference.contract)))
        outputs = session.run(list(contract.outputs), {**feeds, **cache})
        for torch_output, output in zip((x.numpy() for x in expected), outputs, strict=True):
            if not (np.isfinite(output).all() and np.isfinite(torch_output).all()):
                raise ModelError(f"the output for inputs {label!r} is not finite", contract.name,
                                 "expected finite numbers")
            if label not in tolerance:
                continue
            scale = max(np.abs(torch_output).max(), 1e-6)
            difference = float(np.abs(output.astype(np.float32) - torch_output).max() / scale)
            largest = max(largest, difference)
            if difference > tolerance[label]:
                raise ModelError(f"onnxruntime differs from torch by {difference:.2g} for inputs {label!r}",
                                 contract.name, f"expected at most {tolerance[label]}")
    return largest


def _to_torch(inputs: Arrays, contract: ModelContract) -> tuple[torch.Tensor, ...]:
    return tuple(torch.from_numpy(inputs[t].astype(contract.dtype)) for t in contract.inputs)


def _set_contract(model: onnx.ModelProto, contract: ModelContract) -> None:
    metadata = {p.key: p.value for p in model.metadata_props} | {KEY: contract_to_json(contract)}
    onnx.helper.set_model_props(model, metadata)
