"""GL buffers mapped into CUDA: a network that runs on packed tensors without copies through the host."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import torch

from app.network.selection import SURFEL_MODEL
from export.models.ember import Ember
from gpu_sections.common import Json, Options, format_size, max_error, measure_ms, network_of, open_renderer, skipped

READ_ONLY, WRITE_DISCARD = 1, 2  # cudaGraphicsRegisterFlags
OUTPUT = "output"

Tensors = dict[str, torch.Tensor]


class _View:
    """Device memory as torch reads it; see numba's CUDA array interface."""

    def __init__(self, pointer: int, shape: tuple[int, ...]) -> None:
        self.__cuda_array_interface__ = {"shape": shape, "typestr": "<f4", "data": (pointer, False), "version": 3}


class _Runtime:
    """The calls of the CUDA runtime that torch does not wrap."""

    def __init__(self) -> None:
        libraries = sorted((Path(torch.__file__).parents[1] / "nvidia").rglob("libcudart.so*"))
        self._library = ctypes.CDLL(str(libraries[0]) if libraries else "libcudart.so")
        handles = ctypes.POINTER(ctypes.c_void_p)
        self._library.cudaGraphicsGLRegisterBuffer.argtypes = [handles, ctypes.c_uint, ctypes.c_uint]
        self._library.cudaGraphicsMapResources.argtypes = [ctypes.c_int, handles, ctypes.c_void_p]
        self._library.cudaGraphicsUnmapResources.argtypes = [ctypes.c_int, handles, ctypes.c_void_p]
        self._library.cudaGraphicsResourceGetMappedPointer.argtypes = [
            handles, ctypes.POINTER(ctypes.c_size_t), ctypes.c_void_p]
        self._library.cudaGraphicsUnregisterResource.argtypes = [ctypes.c_void_p]

    def call(self, name: str, *arguments: object) -> None:
        error = getattr(self._library, name)(*arguments)
        if error:
            raise RuntimeError(f"{name} failed with CUDA error {error}")


class _Registered:
    """GL buffers by name, registered with CUDA for as long as this is open."""

    def __init__(self, runtime: _Runtime, buffers: Mapping[str, int], shapes: Mapping[str, tuple[int, ...]]) -> None:
        self._runtime, self._shapes = runtime, shapes
        self._handles = {name: ctypes.c_void_p() for name in buffers}
        for name, number in buffers.items():
            runtime.call("cudaGraphicsGLRegisterBuffer", ctypes.byref(self._handles[name]), number,
                         WRITE_DISCARD if name == OUTPUT else READ_ONLY)
        self._array = (ctypes.c_void_p * len(buffers))(*(handle.value for handle in self._handles.values()))

    @contextmanager
    def mapped(self) -> Iterator[Tensors]:
        """The buffers as torch tensors; GL must not use them meanwhile."""
        stream = torch.cuda.current_stream().cuda_stream
        self._runtime.call("cudaGraphicsMapResources", len(self._array), self._array, stream)
        pointer, length = ctypes.c_void_p(), ctypes.c_size_t()
        tensors = {}
        for name, handle in self._handles.items():
            self._runtime.call("cudaGraphicsResourceGetMappedPointer", ctypes.byref(pointer), ctypes.byref(length),
                               handle)
            tensors[name] = torch.as_tensor(_View(pointer.value or 0, self._shapes[name]), device="cuda")
        yield tensors
        tensors.clear()
        self._runtime.call("cudaGraphicsUnmapResources", len(self._array), self._array, stream)

    def close(self) -> None:
        for handle in self._handles.values():
            self._runtime.call("cudaGraphicsUnregisterResource", handle)


def interop(options: Options) -> Json:
    """Cost of mapping, and the difference from onnxruntime on the same tensors."""
    if not torch.cuda.is_available():
        return skipped("torch finds no CUDA device")
    torch.zeros(1, device="cuda")  # makes the context
    runtime = _Runtime()
    return {format_size(size): _measure(size, runtime, options) for size in options.sizes}


def _measure(size: tuple[int, int], runtime: _Runtime, options: Options) -> Json:
    with open_renderer(SURFEL_MODEL, size) as renderer, renderer._gl.ctx, torch.no_grad():
        network = network_of(renderer)
        shapes = {name: values.shape for name, values in network._buffers.items()}
        shapes[OUTPUT] = (1, 3, *shapes["screen"][2:])
        target = renderer._gl.ctx.buffer(reserve=4 * int(np.prod(shapes[OUTPUT])))
        buffers = {name: renderer._gl.ctx.buffer(renderer.resource(f"tensor_{name}").tobytes())
                   for name in network._buffers}
        registered = _Registered(runtime, {name: b.glo for name, b in {**buffers, OUTPUT: target}.items()}, shapes)
        inputs = {name: torch.empty(shapes[name], device="cuda") for name in network._buffers}
        model = Ember().eval().cuda()

        def run(work: Callable[[Tensors], object]) -> None:
            with registered.mapped() as tensors:
                work(tensors)
            torch.cuda.synchronize()

        def draw(tensors: Tensors) -> None:
            for name, tensor in inputs.items():
                tensor.copy_(tensors[name])
            tensors[OUTPUT].copy_(model(**inputs))

        run(draw)
        expected = network._session.run(None, {name: tensor.cpu().numpy() for name, tensor in inputs.items()})[0]
        output = np.frombuffer(target.read(), np.float32).reshape(expected.shape)
        row = {"max_difference": max_error(output, expected),
               "map_and_unmap": measure_ms(lambda: run(lambda tensors: None), options, 100),
               "map_run_unmap": measure_ms(lambda: run(draw), options, 50)}
        registered.close()
        return row
