"""Torch module → ``.onnx`` with its contract inside, checked against torch before it is kept."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import onnxruntime as ort
import torch
from numpy.typing import NDArray

from app.errors import ModelError
from app.golden.scenes import dusk, outdoor, room
from app.io.atomic_files import replacing, write_text
from app.load import embedded_scene
from app.network.channels import CHANNELS, PANORAMA, SCREEN, SEEN, UNSHADOWED_CHANNELS
from app.network.contract import HALF, KEY, ModelContract, TensorSpec
from app.network.static_cache import StaticCache
from export.dataset.network_inputs import Drawer
from export.models import UNTRAINED, Network
from export.models.panorama import merged
from export.onnx.card import card, summary
from export.onnx.graphs import graph_of
from export.reference.still import Still
from export.training.checkpoint import Checkpoint

Arrays = dict[str, NDArray[np.float32]]
Channels = dict[str, NDArray[np.float64]]

# Largest difference between torch and onnxruntime, relative to the largest output. Inputs with other labels only have
# to give numbers. To surfels random points make no surface, so rounding alone decides what belongs together.
SURFELS = {"room": 1e-4, "random": 2e-2}
TRAINED = {"float32": 1e-4, "float16": 1e-2}  # of all inputs
ROOM = 20.0  # radius
ODD = (5, 7)
SIZES = ((1, 1), ODD, (48, 64))
BROKEN = (0.0, np.nan, np.inf, -np.inf, -100.0, 1e6)
REAL_SIZE = (256, 192)


def export_network(name: str, folder: Path) -> Path:
    """Write ``folder/NAME.onnx`` for a network without trained weights; the same torch gives the same bytes every time.

    Raises
    ------
    ModelError
        When onnxruntime disagrees with torch or gives a value that is not finite.
    """
    network = UNTRAINED[name]().eval()
    return write_network(network, folder, cases(network.contract), SURFELS)[0]


def export_checkpoint(checkpoint: Checkpoint, folder: Path, dtypes: Iterable[str] = tuple(TRAINED)) -> list[Path]:
    """Write the averaged network as ``NAME.onnx`` and ``NAME-half.onnx``, and their card ``NAME.md``.

    Raises
    ------
    ModelError
        When onnxruntime differs too much from torch in single precision, or gives a value that is not finite.
    """
    network = checkpoint.network()
    network.contract = replace(network.export_contract(), trained_on=summary(checkpoint))
    inputs = [*real_cases(network.contract), *cases(network.contract)]
    differences = {}
    for dtype in dtypes:
        variant = network if dtype == "float32" else half_of(network)
        path, differences[path] = write_network(variant, folder, inputs, {label: TRAINED[dtype] for label, _ in inputs},
                                                network)
    write_text(folder / f"{network.contract.name}.md", card(checkpoint, network.contract, differences))
    return list(differences)


def half_of(network: Network) -> Network:
    """A copy in half precision; what its forward keeps in single precision stays so."""
    half = copy.deepcopy(network).half()
    half.contract = replace(network.contract, name=f"{network.contract.name}{HALF}", dtype="float16")
    return half


def write_network(network: Network, folder: Path, inputs: Iterable[tuple[str, Arrays]],
                  tolerance: Mapping[str, float], reference: Network | None = None) -> tuple[Path, float]:
    """Write ``folder/NAME.onnx`` if it agrees with ``reference``, or with the network itself, on ``inputs``.

    Returns
    -------
    path : Path
    difference : float
        The largest, as ``compare`` returns it.

    Raises
    ------
    ModelError
        When it does not agree.
    """
    contract = network.contract
    example = _torch(_random(contract, SIZES[-1], np.random.default_rng(0)), contract)
    path = folder / f"{contract.name}.onnx"
    folder.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        model = graph_of(network, example)
        _set_contract(model, contract)
        difference = compare(reference or network, model.SerializeToString(), contract, inputs, tolerance)
        temporary.write_bytes(model.SerializeToString(deterministic=True))
    return path, difference


def stamp(path: Path, contract: ModelContract) -> None:
    """Put a contract into an existing ``.onnx`` file, in place of any other.

    Raises
    ------
    ModelError
        When the file is no ONNX model.
    """
    model = load_model(path)
    _set_contract(model, contract)
    with replacing(path) as temporary:
        temporary.write_bytes(model.SerializeToString(deterministic=True))


def load_model(path: Path) -> onnx.ModelProto:
    """The ONNX model in a file.

    Raises
    ------
    ModelError
        When it is none.
    """
    try:
        return onnx.load(path)
    except Exception as error:  # protobuf's errors share no public base class
        raise ModelError(f"can't read the network ({type(error).__name__})", path, "expected an .onnx file") from None


def compare(reference: Network, model: bytes, contract: ModelContract, inputs: Iterable[tuple[str, Arrays]],
            tolerance: Mapping[str, float]) -> float:
    """Run ``reference`` in torch, in single precision, and ``model`` in onnxruntime on labelled ``inputs``.

    Returns
    -------
    float
        The largest difference, relative to the largest output, over inputs whose label has a tolerance.

    Raises
    ------
    ModelError
        When it exceeds the tolerance, or an output is not finite.
    """
    session = ort.InferenceSession(model, providers=["CPUExecutionProvider"])
    cache = StaticCache(session, contract.static_input).feeds({})
    largest = 0.0
    for label, tensors in inputs:
        with np.errstate(over="ignore"):
            given = {t: x.astype(contract.dtype) for t, x in tensors.items()}
        with torch.no_grad():
            expected = reference(*_torch(given, reference.contract)).numpy()
        found = session.run(list(contract.outputs), {**given, **cache})[0].astype(np.float32)
        if not (np.isfinite(found).all() and np.isfinite(expected).all()):
            raise ModelError(f"the output is not finite for {label} inputs", contract.name, "expected finite numbers")
        if label not in tolerance:
            continue
        difference = float(np.abs(found - expected).max() / max(np.abs(expected).max(), 1e-6))
        largest = max(largest, difference)
        if difference > tolerance[label]:
            raise ModelError(f"onnxruntime differs from torch by {difference:.2g} for {label} inputs", contract.name,
                             f"expected at most {tolerance[label]}")
    return largest


def real_cases(contract: ModelContract) -> Iterator[tuple[str, Arrays]]:
    """What the renderer hands to the network for the Cornell box and two generated scenes."""
    sky = dusk().environment if contract.shades_environment else None
    with Drawer(replace(contract, dtype="float32")) as drawer:
        for scene in (replace(s, environment=sky) for s in (embedded_scene(), room(), outdoor())):
            still = Still(scene, scene.cameras[scene.default_camera].at(0.0), REAL_SIZE)
            yield f"real {scene.name}", {t: x[None] for t, x in drawer.still(still).tensors.items()}


def cases(contract: ModelContract) -> Iterator[tuple[str, Arrays]]:
    """Labelled inputs of several sizes: like a room, random, and partly or wholly broken."""
    rng = np.random.default_rng(1)
    for size in SIZES:
        yield "room", _tensors(contract, size, rng, _room)
        yield "random", _random(contract, size, rng)
    for value in BROKEN:
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
    rows, columns = (-(-n // contract.multiple_of) * contract.multiple_of for n in size)
    for tensor, spec in contract.inputs.items():
        grid = spec.extent((rows, columns))
        given = known(spec, grid, rng)
        tensors[tensor] = np.concatenate([given.get(name, _noise(name, grid, rng)) for name in spec.channels])
    return {tensor: x[None].astype(np.float32) for tensor, x in tensors.items()}


def _room(spec: TensorSpec, grid: tuple[int, ...], rng: np.random.Generator) -> Channels:
    """A sphere seen from 3 off its middle: what a network may meet, without a renderer."""
    if spec.grid not in SEEN:
        return _room_surfels(spec.size or 0, spec.rays or 0, rng)
    view = (spec.face, spec.face) if spec.face else (grid[-1], grid[-2])
    x, y = np.meshgrid(*((2 * np.arange(n) + 1) / n - 1 for n in view))
    front = np.stack([x, -y, -np.ones_like(x)])
    turned = [front[[0, 1, 2]], front * [[[-1]], [[1]], [[-1]]], front[[2, 1, 0]], front[[2, 1, 0]] * -1,
              front[[0, 2, 1]] * -1, front[[0, 2, 1]]]
    rays = front if spec.grid == SCREEN else np.stack(turned, axis=1)
    if spec.grid == PANORAMA:
        rays = merged(rays)
    length = np.linalg.norm(rays, axis=0)
    rays = rays / length
    middle = np.array([1.0, 2.0, 2.0]).reshape(3, *[1] * (rays.ndim - 1))
    along = (rays * middle).sum(axis=0)
    points = rays * (along + np.sqrt(along ** 2 + ROOM ** 2 - 9.0))
    normals = (middle - points) / ROOM
    depth = -points[2:] if spec.grid == SCREEN else np.linalg.norm(points, axis=0, keepdims=True)
    return {"position.view.xyz": points, "normal.view.xyz": normals, "normal.world.xyz": normals,
            "depth": depth, "solid_angle": (4 / (grid[-1] * grid[-2]) / length ** 3)[None],
            **dict.fromkeys(("radiance.rgb", "surface_and_sky_radiance.rgb", "direct.rgb", *UNSHADOWED_CHANNELS), 1 + normals)}


def _room_surfels(count: int, rays: int, rng: np.random.Generator) -> Channels:
    """Surfels all over the same sphere; each ray may meet any, as inside a sphere."""
    normals = rng.normal(size=(3, count))
    normals /= np.linalg.norm(normals, axis=0)
    return {"position.view.xyz": np.array([[1.0], [2.0], [2.0]]) - ROOM * normals, "normal.view.xyz": normals,
            "irradiance.rgb": 1 + normals, "surfel.radius": np.full((1, count), 8 * ROOM / max(count, 1) ** 0.5),
            "ray.surfel": rng.integers(-1, max(count, 1), (1, count, rays)).astype(float)}


def _noise(name: str, grid: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.float64]:
    channel = CHANNELS[name]
    low, high = max(channel.range[0], -20.0), min(channel.range[1], 20.0)
    if name == "solid_angle":
        high = 4 * np.pi / float(np.prod(grid))
    noise = rng.uniform(low, high, (channel.components, *grid))
    return noise / np.linalg.norm(noise, axis=0) if name.startswith("normal") else noise


def _torch(inputs: Arrays, contract: ModelContract) -> tuple[torch.Tensor, ...]:
    return tuple(torch.from_numpy(inputs[t].astype(contract.dtype)) for t in contract.inputs)


def _set_contract(model: onnx.ModelProto, contract: ModelContract) -> None:
    kept = {p.key: p.value for p in model.metadata_props} | {KEY: contract.to_json()}
    onnx.helper.set_model_props(model, kept)
