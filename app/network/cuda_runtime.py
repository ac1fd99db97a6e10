"""The calls of the CUDA runtime that share GL buffers with onnxruntime."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import util
from pathlib import Path
from threading import RLock
from typing import Any

from app.errors import DeviceError

CUDA_REMEDY = "pip uninstall onnxruntime; pip install 'onnxruntime-gpu[cuda,cudnn]'"  # both fill the same folder
CUDA_LOCK = RLock()  # of the stream that all of the process shares
READ_ONLY, WRITE_DISCARD = 1, 2  # cudaGraphicsRegisterFlags
_ALL_DEVICES = 1                 # cudaGLDeviceList
_MAX_DEVICES = 16
_LIBRARIES = ("libcudart.so.13", "libcudart.so.12", "libcudart.so")  # as the dynamic linker finds them
_HANDLES = ctypes.POINTER(ctypes.c_void_p)
_ARGUMENTS: dict[str, tuple[Any, ...]] = {
    "cudaStreamCreate": (_HANDLES,),
    "cudaStreamSynchronize": (ctypes.c_void_p,),
    "cudaGLGetDevices": (ctypes.POINTER(ctypes.c_uint), ctypes.POINTER(ctypes.c_int), ctypes.c_uint, ctypes.c_int),
    "cudaGraphicsGLRegisterBuffer": (_HANDLES, ctypes.c_uint, ctypes.c_uint),
    "cudaGraphicsMapResources": (ctypes.c_int, _HANDLES, ctypes.c_void_p),
    "cudaGraphicsResourceGetMappedPointer": (_HANDLES, ctypes.POINTER(ctypes.c_size_t), ctypes.c_void_p),
    "cudaGraphicsUnmapResources": (ctypes.c_int, _HANDLES, ctypes.c_void_p),
    "cudaGraphicsUnregisterResource": (ctypes.c_void_p,),
}


class CudaRuntime:
    """CUDA's runtime library on its first device, and a stream of it.

    Attributes
    ----------
    device : str
        onnxruntime's name for the memory at its addresses.
    stream : int
        The stream that everything is ordered by, onnxruntime's work included.
    """

    device = "cuda"

    def __init__(self, library: Any) -> None:
        self._library = library
        for name, arguments in _ARGUMENTS.items():
            getattr(library, name).argtypes = arguments
        stream = ctypes.c_void_p()
        self._call("cudaStreamCreate", ctypes.byref(stream))
        self.stream = stream.value or 0

    def synchronize(self) -> None:
        """Wait for everything on the stream."""
        self._call("cudaStreamSynchronize", ctypes.c_void_p(self.stream))

    def shares_device(self) -> bool:
        """Whether the current GL context draws on CUDA's first device, where onnxruntime computes."""
        count, devices = ctypes.c_uint(), (ctypes.c_int * _MAX_DEVICES)()
        try:
            self._call("cudaGLGetDevices", ctypes.byref(count), devices, _MAX_DEVICES, _ALL_DEVICES)
        except DeviceError:  # the context is of a driver without CUDA
            return False
        return 0 in devices[:count.value]

    def register(self, buffer: int, flags: int) -> int:
        """A resource for GL's ``buffer``, which must be unregistered before the buffer is deleted."""
        resource = ctypes.c_void_p()
        self._call("cudaGraphicsGLRegisterBuffer", ctypes.byref(resource), buffer, flags)
        return resource.value or 0

    def unregister(self, resource: int) -> None:
        """Let go of a buffer."""
        self._call("cudaGraphicsUnregisterResource", ctypes.c_void_p(resource))

    @contextmanager
    def mapped(self, resources: Sequence[int]) -> Iterator[list[int]]:
        """The addresses of buffers on the device; OpenGL must not use these meanwhile."""
        handles = (ctypes.c_void_p * len(resources))(*resources)
        self._call("cudaGraphicsMapResources", len(handles), handles, ctypes.c_void_p(self.stream))
        try:
            yield [self._address(resource) for resource in resources]
        finally:
            self._call("cudaGraphicsUnmapResources", len(handles), handles, ctypes.c_void_p(self.stream))

    def _address(self, resource: int) -> int:
        address, size = ctypes.c_void_p(), ctypes.c_size_t()
        self._call("cudaGraphicsResourceGetMappedPointer", ctypes.byref(address), ctypes.byref(size),
                   ctypes.c_void_p(resource))
        return address.value or 0

    def _call(self, name: str, *arguments: object) -> None:
        if error := getattr(self._library, name)(*arguments):
            raise DeviceError(f"{name} failed with CUDA error {error}", "CUDA",
                              "expected a driver that shares OpenGL's buffers with CUDA, or the provider cpu")


@cache
def find_cuda() -> CudaRuntime | None:
    """The runtime, one for the whole process; None where its library or a GPU for it is missing."""
    for name in (*packaged_libraries(), *_LIBRARIES):
        try:
            return CudaRuntime(ctypes.CDLL(name))
        except (OSError, AttributeError, DeviceError):
            continue
    return None


@cache
def packaged_libraries() -> tuple[str, ...]:
    """Where NVIDIA's Python packages have the library."""
    spec = util.find_spec("nvidia")
    folders = spec.submodule_search_locations if spec is not None else None
    return tuple(str(file) for folder in folders or () for file in sorted(Path(folder).rglob("libcudart.so*")))
