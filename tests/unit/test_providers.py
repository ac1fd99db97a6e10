"""Which execution providers sessions get, and with which options."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import onnxruntime as ort
import pytest

from app.errors import ModelError
from app.network import cuda_runtime, providers, session
from app.network.providers import NO_CUDA_GRAPH, open_session
from app.network.selection import find_model
from app.network.session import Network


@pytest.fixture
def with_cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    """An onnxruntime that has CUDA, whose libraries are not loaded."""
    monkeypatch.setattr(ort, "get_available_providers", lambda: ["CUDAExecutionProvider", "CPUExecutionProvider"])
    monkeypatch.setattr(providers, "load_cuda_libraries", lambda: None)


@pytest.mark.parametrize(("provider", "expected"), [
    ("auto", ["CUDAExecutionProvider", "CPUExecutionProvider"]), ("cpu", ["CPUExecutionProvider"])])
@pytest.mark.usefixtures("with_cuda")
def test_cuda_multiplies_in_full_precision(provider: str, expected: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(ort, "InferenceSession", lambda *_, providers, **__: asked.extend(providers))
    open_session(Path("network.onnx"), provider)
    assert [name for name, _ in asked] == expected
    assert all(options.get("use_tf32") == "0" for name, options in asked if name.startswith("CUDA"))


@pytest.mark.parametrize("stream", [0x4711, None])
@pytest.mark.usefixtures("with_cuda")
def test_onnxruntime_computes_on_the_stream_that_buffers_are_mapped_on(stream: int | None,
                                                                      monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(ort, "InferenceSession", lambda *_, providers, **__: asked.extend(providers))
    monkeypatch.setattr(providers, "find_cuda", lambda: None if stream is None else SimpleNamespace(stream=stream))
    open_session(Path("network.onnx"), "cuda")
    assert [options.get("user_compute_stream") for _, options in asked] == [None if stream is None else "18193", None]


@pytest.mark.parametrize(("provider", "packages", "expected"),
                         [("auto", True, 1), ("auto", False, 0), ("cpu", True, 0)])
def test_the_libraries_of_cuda_are_loaded_from_their_packages(provider: str, packages: bool, expected: int,
                                                              monkeypatch: pytest.MonkeyPatch) -> None:
    """The dynamic linker does not look there."""
    loaded: list[str] = []
    providers.load_cuda_libraries.cache_clear()
    monkeypatch.setattr(ort, "get_available_providers", lambda: ["CUDAExecutionProvider", "CPUExecutionProvider"])
    monkeypatch.setattr(ort, "InferenceSession", lambda *_, **__: None)
    monkeypatch.setattr(ort, "set_default_logger_severity", lambda severity: None)
    monkeypatch.setattr(ort, "preload_dlls", lambda: loaded.append("CUDA"), raising=False)
    monkeypatch.setattr(providers, "packaged_libraries", lambda: ["libcudart.so.13"] if packages else [])
    for _ in range(2):
        open_session(Path("network.onnx"), provider)
    providers.load_cuda_libraries.cache_clear()
    assert len(loaded) == expected


@pytest.mark.parametrize(("broken", "opened"), [
    ((), ["captured"]), (("captured",), ["captured", "CUDA"]), (("captured", "CUDA"), ["captured", "CUDA", "CPU"])])
@pytest.mark.usefixtures("with_cuda")
def test_a_network_is_captured_where_it_can_be_and_runs_on_the_cpu_where_cuda_fails(
        broken: tuple[str, ...], opened: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def open_one(*_: object, providers: list[Any], enable_fallback: bool) -> None:
        name, options = providers[0]
        asked.append("CPU" if name.startswith("CPU") else "captured" if "enable_cuda_graph" in options else "CUDA")
        if enable_fallback or asked[-1] in broken:
            raise RuntimeError(f"{asked[-1]} does not work")

    monkeypatch.setattr(ort, "InferenceSession", open_one)
    open_session(Path("network.onnx"), "auto", captures=True)
    assert asked == opened
    asked.clear()
    open_session(Path("network.onnx"), "auto")
    assert "captured" not in asked


def test_a_network_that_fails_on_cuda_runs_on_the_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """As without cuDNN, which only some networks need."""
    class OnCuda:
        def __init__(self, session: Any) -> None:
            self._session = session

        def __getattr__(self, name: str) -> Any:
            return getattr(self._session, name)

        def get_providers(self) -> list[str]:
            return ["CUDAExecutionProvider", "CPUExecutionProvider"]

        def run(self, *arguments: object) -> None:
            raise RuntimeError("cuDNN is missing")

    def open_one(path: Path, provider: str, captures: bool) -> Any:
        opened = open_session(path, "cpu", captures)
        return opened if provider == "cpu" else OnCuda(opened)

    monkeypatch.setattr(session, "open_session", open_one)
    assert Network(find_model("bcnn-8"), (8, 8)).provider == "cpu"
    with pytest.raises(ModelError, match="cuDNN is missing"):
        Network(find_model("bcnn-8"), (8, 8), "cuda")


def test_each_binding_is_captured_as_a_graph_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other runs of the session are not captured."""
    graphs: list[str] = []
    real = ort.RunOptions

    def record() -> Any:
        options = real()
        return SimpleNamespace(add_run_config_entry=lambda key, value: graphs.append(value) or
                               options.add_run_config_entry(key, value), options=options)

    network = Network(find_model("bcnn-8"), (8, 8), "cpu")
    binding = SimpleNamespace(bind_input=lambda *_: None, bind_output=lambda *_: None)
    network._session = SimpleNamespace(io_binding=lambda: binding)
    monkeypatch.setattr(ort, "RunOptions", record)
    addresses = dict.fromkeys((*network.contract.inputs, *network.contract.outputs), 0)
    for captures in (True, False, True):
        network.bind(addresses, (8, 8), captures=captures)
    assert graphs == ["1", NO_CUDA_GRAPH, "2"]


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
