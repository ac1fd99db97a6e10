"""A stand-in for CUDA's runtime library that keeps books: its memory is the host's, misuse raises AssertionError.

Each mapping gives other addresses. What is unmapped holds NaN from then on, and must still hold it at the end.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.network.cuda_runtime import READ_ONLY, WRITE_DISCARD, CudaRuntime

GL_BUFFER_SIZE, GL_BUFFER_MAPPED = 0x8764, 0x88BC
INVALID_DEVICE = 101  # cudaErrorInvalidDevice


class _Function:
    """A function of a library of ctypes: its arguments must fit ``argtypes``."""

    def __init__(self, run: Callable[..., int]) -> None:
        self._run = run
        self.argtypes: tuple[Any, ...] = ()

    def __call__(self, *arguments: Any) -> int:
        assert len(arguments) == len(self.argtypes)
        for kind, argument in zip(self.argtypes, arguments, strict=True):
            kind.from_param(argument)
        return self._run(*arguments)


@dataclass(eq=False)
class _Resource:
    buffer: int
    flags: int
    memory: NDArray[np.float32] | None = None    # while it is mapped
    original: NDArray[np.float32] | None = None  # what GL had in the buffer then


class FakeCudart:
    """The functions of libcudart that ``CudaRuntime`` calls, in a process with a current GL context.

    Parameters
    ----------
    devices : sequence of int
        CUDA devices that the context draws on.
    """

    def __init__(self, devices: Sequence[int] = (0,)) -> None:
        self._devices = devices
        self._streams: list[int] = []
        self._used_stream: int | None = None
        self._next = 0x1000
        self._resources: dict[int, _Resource] = {}
        self._unmapped: list[NDArray[np.float32]] = []
        self.mappings = 0
        self._has_work = False  # which nobody has waited for
        self.cudaStreamCreate = _Function(self._create_stream)
        self.cudaStreamSynchronize = _Function(self._synchronize)
        self.cudaGLGetDevices = _Function(self._list_devices)
        self.cudaGraphicsGLRegisterBuffer = _Function(self._register)
        self.cudaGraphicsUnregisterResource = _Function(self._unregister)
        self.cudaGraphicsMapResources = _Function(self._map)
        self.cudaGraphicsResourceGetMappedPointer = _Function(self._find_address)
        self.cudaGraphicsUnmapResources = _Function(self._unmap)

    def runtime(self) -> CudaRuntime:
        """A runtime whose memory onnxruntime's CPU provider can use."""
        runtime = CudaRuntime(self)
        runtime.device = "cpu"
        return runtime

    def close(self) -> None:
        """Check that nothing is registered or runs any more, and nothing was written after it was unmapped."""
        assert not self._resources, f"leak: {len(self._resources)} buffers are still registered"
        assert not self._has_work, "nobody has waited for the stream, on which onnxruntime still frees memory"
        self._check_unmapped()

    def _create_stream(self, stream: Any) -> int:
        self._streams.append(self._number())
        stream._obj.value = self._streams[-1]
        return 0

    def _synchronize(self, stream: Any) -> int:
        self._check_stream(stream)
        self._has_work = False
        return 0

    def _list_devices(self, count: Any, devices: Any, room: int, listed: int) -> int:
        if not self._devices:
            return INVALID_DEVICE
        assert len(self._devices) <= room and listed == 1
        count._obj.value = len(self._devices)
        for place, device in enumerate(self._devices):
            devices[place] = device
        return 0

    def _register(self, resource: Any, buffer: int, flags: int) -> int:
        assert _gl("glIsBuffer", buffer, result=ctypes.c_ubyte), f"GL has no buffer {buffer}"
        assert all(other.buffer != buffer for other in self._resources.values()), "registered twice"
        assert flags in (READ_ONLY, WRITE_DISCARD)
        resource._obj.value = self._number()
        self._resources[resource._obj.value] = _Resource(buffer, flags)
        return 0

    def _unregister(self, resource: Any) -> int:
        assert self._find(resource.value).memory is None, "unregistered while mapped"
        del self._resources[resource.value]
        return 0

    def _map(self, count: int, resources: Any, stream: Any) -> int:
        self._check_stream(stream)
        self._check_unmapped()
        for number in resources[:count]:
            each = self._find(number)
            assert each.memory is None, "mapped twice"
            assert not _buffer_parameter(each.buffer, GL_BUFFER_MAPPED), "mapped by GL"
            each.original = _read(each.buffer)
            each.memory = each.original.copy() if each.flags == READ_ONLY else np.full_like(each.original, np.nan)
        self.mappings += 1
        return 0

    def _find_address(self, address: Any, size: Any, resource: Any) -> int:
        memory = self._find(resource.value).memory
        assert memory is not None, "used while it is not mapped"
        address._obj.value, size._obj.value = memory.ctypes.data, memory.nbytes
        return 0

    def _unmap(self, count: int, resources: Any, stream: Any) -> int:
        self._check_stream(stream)
        for number in resources[:count]:
            each = self._find(number)
            assert each.memory is not None and each.original is not None, "unmapped twice"
            assert _read(each.buffer).tobytes() == each.original.tobytes(), "GL wrote a buffer that CUDA had mapped"
            if each.flags == READ_ONLY:
                assert each.memory.tobytes() == each.original.tobytes(), "CUDA wrote a buffer that is read-only"
            else:
                _gl("glNamedBufferSubData", each.buffer, ctypes.c_ssize_t(0), ctypes.c_ssize_t(each.memory.nbytes),
                    ctypes.c_void_p(each.memory.ctypes.data))
            each.memory[:] = np.nan
            self._has_work = True
            self._unmapped.append(each.memory)
            each.memory = each.original = None
        return 0

    def _number(self) -> int:
        self._next += 1
        return self._next

    def _find(self, number: int) -> _Resource:
        assert number in self._resources, "the resource is not registered"
        return self._resources[number]

    def _check_stream(self, stream: Any) -> None:
        assert stream.value in self._streams, "no such stream"
        assert self._used_stream in (None, stream.value), "two different streams"
        self._used_stream = stream.value

    def _check_unmapped(self) -> None:
        assert all(np.isnan(memory).all() for memory in self._unmapped), "memory was written after it was unmapped"


def _gl(name: str, *arguments: Any, result: Any = None) -> Any:
    egl = ctypes.CDLL("libEGL.so.1")
    egl.eglGetProcAddress.restype, egl.eglGetProcAddress.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    kinds = [ctypes.c_uint if isinstance(argument, int) else type(argument) for argument in arguments]
    return ctypes.CFUNCTYPE(result, *kinds)(egl.eglGetProcAddress(name.encode()))(*arguments)


def _buffer_parameter(buffer: int, parameter: int) -> int:
    value = ctypes.c_int()
    _gl("glGetNamedBufferParameteriv", buffer, parameter, ctypes.pointer(value))
    return value.value


def _read(buffer: int) -> NDArray[np.float32]:
    """What GL has in a buffer; unlike ``moderngl.Buffer.read`` without mapping it."""
    values = np.empty(_buffer_parameter(buffer, GL_BUFFER_SIZE) // 4, np.float32)
    _gl("glGetNamedBufferSubData", buffer, ctypes.c_ssize_t(0), ctypes.c_ssize_t(values.nbytes),
        ctypes.c_void_p(values.ctypes.data))
    return values
