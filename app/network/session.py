"""A network in onnxruntime: one call per frame, between inputs that are prepared and outputs that are checked."""

from collections.abc import Callable, Mapping
from itertools import count
from pathlib import Path

import numpy as np
import onnxruntime as ort

from app.arrays import F32
from app.errors import DeviceError, ModelError
from app.network.channels import CHANNELS, SCREEN
from app.network.contract import TensorSpec
from app.network.contract_json import read_contract
from app.network.cuda_runtime import find_cuda
from app.network.inputs import channel_bounds, clamp, prepare_inputs
from app.network.providers import (
    AUTO,
    CPU,
    CUDA,
    NO_CUDA_GRAPH,
    exclusive,
    one_line,
    open_session,
    run_options,
    short_name,
)
from app.network.static_cache import StaticCache, is_cache_tensor

_ORT_TYPES = {"float32": "tensor(float)", "float16": "tensor(float16)"}


class Network:
    """A loaded, checked and warmed-up network.

    Parameters
    ----------
    path : path
        ``.onnx`` file with a contract.
    size : tuple of int
        Width and height of the screen grid, ``contract.screen_size(output)``; later frames may have another one.
    provider : str
        ``auto`` (CUDA if it works, else the CPU) or the short name of an execution provider.
    strict : bool
        Refuse to run on any other provider.
    scale : float or None
        Replaces the contract's.

    Attributes
    ----------
    contract : ModelContract
    provider : str
        Short name of the execution provider in use, such as ``cpu``.
    cuda : CudaRuntime or None
        CUDA's runtime, if onnxruntime computes on its stream.

    Raises
    ------
    ModelError
        When the file or its contract is invalid, they contradict each other, or the warm-up run fails.
    SettingsError
        When this onnxruntime has no such provider.
    DeviceError
        When ``strict`` and onnxruntime fell back to another provider.
    """

    def __init__(self, path: Path | str, size: tuple[int, int], provider: str = AUTO, strict: bool = False,
                 scale: float | None = None) -> None:
        self.path = Path(path)
        self.contract = read_contract(path).with_scale(scale)
        self._graph_numbers = count(1)
        self._open(provider)
        if strict and provider not in (AUTO, self.provider):
            raise DeviceError(f"the network runs on {self.provider!r}", "strict_device", f"expected {provider!r}")
        self._check_graph("input", self.contract.inputs, self._session.get_inputs())
        self._check_graph("output", self.contract.outputs, self._session.get_outputs())
        self._output_bounds = {t: channel_bounds(spec) for t, spec in self.contract.outputs.items()}
        try:
            self.resize(size)
        except ModelError:
            if provider != AUTO or self.provider != CUDA:
                raise
            self._open(CPU)  # since CUDA lacks something, such as cuDNN
            self.resize(size)

    def _open(self, provider: str) -> None:
        self._session = open_session(self.path, provider, captures=self.is_bindable)
        self.provider = short_name(self._session.get_providers()[0])
        self.cuda = find_cuda() if self.provider == CUDA else None
        static_input = self.contract.static_input
        try:
            self._cache = StaticCache(self._session, static_input)
        except ValueError as error:
            raise ModelError(str(error), self.path, f"expected a graph that caches what depends on {static_input!r} "
                             "alone, as its contract declares") from None

    def resize(self, size: tuple[int, int]) -> None:
        """Allocate for a screen grid of the given width and height, and do a warm-up run."""
        self._allocate((size[1], size[0]))
        self._cache.clear()
        self.run({t: np.zeros((s.components, *s.extent(self._size)), np.float32)
                  for t, s in self.contract.inputs.items()})

    def _allocate(self, size: tuple[int, ...]) -> None:
        """Buffers for a screen grid of the given height and width."""
        self._size, contract = size, self.contract
        self._buffers = {t: np.zeros(shape, np.float32)
                         for t, shape in contract.padded_shapes(contract.inputs, (size[1], size[0])).items()}
        self._output_shapes = contract.padded_shapes(contract.outputs, (size[1], size[0]))
        self._unchanged: dict[str, F32] = {}  # read-only tensors whose results are in the buffers

    def run(self, tensors: Mapping[str, F32]) -> dict[str, F32]:
        """Infer one frame.

        Parameters
        ----------
        tensors : mapping of str to ndarray, float32
            For each input tensor its ``TensorSpec.shape``, top row first. Not modified; NaN becomes the channel's
            background, and infinities the ends of its range. A read-only tensor without radiance must hold the same
            numbers when it is passed again: it is prepared once.

        Returns
        -------
        dict of str to ndarray, float32, shape (C, h, w), or (C, S) on surfels
            By output channel name, finite and inside the channel's range, top row first.

        Raises
        ------
        ModelError
            When onnxruntime fails or returns a tensor of another shape.
        """
        size = next((tensors[t].shape[-2:] for t, s in self.contract.inputs.items() if s.grid == SCREEN), self._size)
        if size != self._size:
            self._allocate(size)
        h, w = self._size
        cropped = {t: self._buffers[t][0, ..., :h, :w] if s.grid == SCREEN else self._buffers[t][0]
                   for t, s in self.contract.inputs.items()}
        exposure = prepare_inputs(self.contract, tensors, cropped,
                                  [t for t, x in self._unchanged.items() if tensors[t] is x])
        self._unchanged = {t: tensors[t] for t, spec in self.contract.inputs.items()
                           if not (tensors[t].flags.writeable or spec.has_radiance)}
        for t, spec in self.contract.inputs.items():
            if spec.grid == SCREEN:  # pad by repeating the edge
                self._buffers[t][..., w:] = self._buffers[t][..., w - 1:w]
                self._buffers[t][..., h:, :] = self._buffers[t][..., h - 1:h, :]
        results = self._infer()
        out: dict[str, F32] = {}
        for (t, spec), result in zip(self.contract.outputs.items(), results, strict=True):
            if result.shape != self._output_shapes[t]:
                raise ModelError(f"output {t!r} has the shape {list(result.shape)}", self.path,
                                 f"expected {list(self._output_shapes[t])}")
            result = result[0, :, :h, :w] if spec.grid == SCREEN else result[0]
            result = clamp(result.astype(np.float32), *self._output_bounds[t])
            for name, rows in spec.rows():
                if CHANNELS[name].radiance:
                    result[rows] = np.minimum(result[rows] * np.float32(exposure), CHANNELS[name].range[1])
                out[name] = result[rows]
        return out

    def _infer(self) -> list[F32]:
        """The contract's outputs for what is in the buffers."""
        inputs = {t: b.astype(self.contract.dtype, copy=False) for t, b in self._buffers.items()}
        cached = self._cache.feeds(inputs)
        names = [*self.contract.outputs, *self._cache.outputs(cached)]
        try:
            with exclusive(self.provider):
                results = self._session.run(names, {**inputs, **cached}, run_options(NO_CUDA_GRAPH))
        except Exception as error:  # onnxruntime's own exceptions share no public base class
            raise self._failure(error, (self._size[1], self._size[0])) from None
        count = len(self.contract.outputs)
        self._cache.update(inputs, results[count:])
        return results[:count]

    @property
    def is_bindable(self) -> bool:
        """Whether onnxruntime alone makes the outputs from prepared inputs, without a conversion or a cache."""
        return self.contract.dtype == "float32" and self.contract.static_input is None

    def bind(self, addresses: Mapping[str, int], size: tuple[int, int], device: str = "cpu",
             captures: bool = False) -> Callable[[], None]:
        """A function that infers from prepared inputs in memory to outputs in memory.

        Parameters
        ----------
        addresses : mapping of str to int
            Of all tensors of the graph on ``device``: float32, with the batch and the padded grid.
        size : tuple of int
            Width and height of the screen grid.
        device : str
            onnxruntime's name of it; on ``cuda`` the function may return before the outputs are there.
        captures : bool
            Where it can, capture the network as a CUDA graph at the function's first call, and replay it from then on.
            onnxruntime keeps the graph as long as this network.
        """
        binding = self._session.io_binding()
        for specs, bind in ((self.contract.inputs, binding.bind_input), (self.contract.outputs, binding.bind_output)):
            for tensor, shape in self.contract.padded_shapes(specs, size).items():
                bind(tensor, device, 0, np.float32, shape, addresses[tensor])
        options = run_options(str(next(self._graph_numbers)) if captures else NO_CUDA_GRAPH)
        if device == CUDA:  # what follows is on the same stream
            options.add_run_config_entry("disable_synchronize_execution_providers", "1")

        def infer() -> None:
            try:
                self._session.run_with_iobinding(binding, options)
            except Exception as error:  # onnxruntime's own exceptions share no public base class
                raise self._failure(error, size) from None

        return infer

    def _failure(self, error: Exception, size: tuple[int, int]) -> ModelError:
        return ModelError(f"the network failed ({one_line(error)})", self.path,
                          f"expected it to run on a grid of {size[0]}x{size[1]}")

    def _check_graph(self, kind: str, specs: Mapping[str, TensorSpec], nodes: list[ort.NodeArg]) -> None:
        """Compare the contract's tensors with those of the graph, besides the cache's."""
        has_cache = self.contract.static_input is not None
        tensors = {n.name: n for n in nodes if not (has_cache and is_cache_tensor(n.name))}
        if set(specs) != set(tensors):
            raise ModelError(f"the contract's {kind}s are {sorted(specs)}", self.path,
                             f"expected the graph's {kind}s {sorted(tensors)}")
        dtype = _ORT_TYPES[self.contract.dtype]
        for t, spec in specs.items():
            shape, expected = tensors[t].shape, (1, spec.components, *spec.extent(("h", "w")))
            fits = len(shape) == len(expected) and all(
                n == m or not (isinstance(n, int) and isinstance(m, int)) for n, m in zip(shape, expected, strict=True))
            if not fits:
                raise ModelError(f"{kind} {t!r} of the graph has the shape {shape}", self.path,
                                 f"expected {list(expected)} for {', '.join(spec.channels)}")
            if tensors[t].type != dtype:
                raise ModelError(f"{kind} {t!r} of the graph is a {tensors[t].type}", self.path,
                                 f"expected {dtype}, the contract's dtype")
