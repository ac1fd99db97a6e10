"""Which execution providers sessions get, and with which options."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import onnxruntime as ort
import pytest

from app.network import cuda_runtime, providers
from app.network.providers import open_session


@pytest.mark.parametrize(("provider", "expected"), [
    ("auto", ["CUDAExecutionProvider", "CPUExecutionProvider"]), ("cpu", ["CPUExecutionProvider"])])
def test_cuda_multiplies_in_full_precision(provider: str, expected: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(ort, "get_available_providers", lambda: ["CUDAExecutionProvider", "CPUExecutionProvider"])
    monkeypatch.setattr(ort, "InferenceSession", lambda *_, providers, **__: asked.extend(providers))
    open_session(Path("network.onnx"), provider)
    assert [name for name, _ in asked] == expected
    assert all(options.get("use_tf32") == "0" for name, options in asked if name.startswith("CUDA"))


@pytest.mark.parametrize("stream", [0x4711, None])
def test_onnxruntime_computes_on_the_stream_that_buffers_are_mapped_on(stream: int | None,
                                                                      monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(ort, "get_available_providers", lambda: ["CUDAExecutionProvider", "CPUExecutionProvider"])
    monkeypatch.setattr(ort, "InferenceSession", lambda *_, providers, **__: asked.extend(providers))
    monkeypatch.setattr(providers, "find_cuda", lambda: None if stream is None else SimpleNamespace(stream=stream))
    open_session(Path("network.onnx"), "cuda")
    assert [options.get("user_compute_stream") for _, options in asked] == [None if stream is None else "18193", None]


@pytest.mark.parametrize("can_capture", [True, False])
def test_a_network_is_captured_where_it_can_be(can_capture: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def open_one(*_: object, providers: list[Any], **fallback: bool) -> None:
        asked.append(providers[0][1].get("enable_cuda_graph"))
        if asked[-1] is not None and not can_capture:
            assert fallback == {"enable_fallback": False}  # which would print
            raise RuntimeError("not all nodes run on CUDA")

    monkeypatch.setattr(ort, "get_available_providers", lambda: ["CUDAExecutionProvider", "CPUExecutionProvider"])
    monkeypatch.setattr(ort, "InferenceSession", open_one)
    open_session(Path("network.onnx"), "auto", captures=True)
    assert asked == (["1"] if can_capture else ["1", None])
    asked.clear()
    open_session(Path("network.onnx"), "auto")
    assert asked == [None]


def test_without_a_library_there_is_no_cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise OSError(name)

    monkeypatch.setattr(cuda_runtime.ctypes, "CDLL", missing)
    assert cuda_runtime.find_cuda.__wrapped__() is None


def test_without_a_gpu_there_is_no_cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    """The library is there, but its first call fails."""
    class Function:
        def __call__(self, *arguments: object) -> int:
            return 100  # cudaErrorNoDevice

    class Library:
        def __getattr__(self, name: str) -> Function:
            return Function()

    monkeypatch.setattr(cuda_runtime.ctypes, "CDLL", lambda name: Library())
    assert cuda_runtime.find_cuda.__wrapped__() is None
