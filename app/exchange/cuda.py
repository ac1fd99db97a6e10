"""Tensors that stay on the GPU: GL buffers that CUDA maps, on the stream that onnxruntime computes on."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from app.exchange.shared import SharedExchange
from app.gl.context import Device
from app.network.cuda_runtime import CUDA_LOCK, READ_ONLY, WRITE_DISCARD, CudaRuntime

if TYPE_CHECKING:
    from app.network.session import Network


class CudaExchange(SharedExchange):
    """Registers its buffers with ``runtime``, and maps them while onnxruntime runs.

    On the GPU, CUDA waits for OpenGL at mapping, and OpenGL for CUDA at unmapping; the CPU waits for neither.
    """

    name = "cuda"

    def __init__(self, device: Device, network: Network, size: tuple[int, int], runtime: CudaRuntime) -> None:
        super().__init__(device, network, size)
        self._network, self._size, self._runtime = network, size, runtime
        outputs = network.contract.outputs
        self._resources = {t: runtime.register(buffer.glo, WRITE_DISCARD if t in outputs else READ_ONLY)
                           for t, buffer in self.buffers.items()}
        self._addresses: dict[str, int] = {}
        self._run: Callable[[], None] | None = None

    def release(self) -> None:
        with CUDA_LOCK:
            self._runtime.synchronize()  # onnxruntime would free memory in a callback on the stream, which aborts
            for resource in self._resources.values():
                self._runtime.unregister(resource)
        super().release()

    def _infer(self) -> None:
        with CUDA_LOCK, self._runtime.mapped([*self._resources.values()]) as mapped:
            addresses = dict(zip(self._resources, mapped, strict=True))
            if self._run is None or addresses != self._addresses:  # each mapping may give others
                self._run = self._network.bind(addresses, self._size, self._runtime.device, captures=self._run is None)
                self._addresses = addresses
            self._run()
