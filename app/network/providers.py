"""Execution providers of onnxruntime: which exist, and sessions on one of them."""

import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from pathlib import Path

import onnxruntime as ort

from app.errors import ModelError, SettingsError, did_you_mean
from app.network.cuda_runtime import CUDA_LOCK, CUDA_REMEDY, find_cuda, packaged_libraries

AUTO, CUDA, CPU = "auto", "cuda", "cpu"
MAX_REASON_LENGTH = 200
LOG_NOTHING = 4  # onnxruntime's severities
CUDA_GRAPH, NO_CUDA_GRAPH = "gpu_graph_id", "-1"  # an option of a run, and its value for one that is not captured
_REMOTE = ("AzureExecutionProvider",)  # sends data to a server: never a choice here


def list_providers() -> list[str]:
    """Short names of the execution providers of this onnxruntime, fastest first."""
    return [short_name(name) for name in ort.get_available_providers() if name not in _REMOTE]


def check_provider(provider: str) -> None:
    """Refuse what is neither ``auto`` nor a provider of this onnxruntime.

    Raises
    ------
    SettingsError
        When ``provider`` is unknown; lists the known ones.
    """
    known = (AUTO, *list_providers())
    if provider not in known:
        expected = did_you_mean(provider, known)
        raise SettingsError(f"this onnxruntime has no provider {provider!r}", "provider",
                            f"{expected}, or for NVIDIA GPUs: {CUDA_REMEDY}" if provider == CUDA else expected)


def open_session(path: Path, provider: str, captures: bool = False) -> ort.InferenceSession:
    """A session on ``provider``, or for ``auto`` on CUDA if there is any; on the CPU where that one does not work.

    On CUDA it ``captures``, where all of the network runs there: each run needs the option ``CUDA_GRAPH``, which is
    either ``NO_CUDA_GRAPH`` or the number of the graph that it is captured as, or replayed.

    Raises
    ------
    SettingsError
        When this onnxruntime has no such provider.
    ModelError
        When onnxruntime can't load the file.
    """
    check_provider(provider)
    chosen = provider if provider != AUTO else CUDA if CUDA in list_providers() else CPU
    options = ort.SessionOptions()
    options.graph_optimization_level = ort.GraphOptimizationLevel.ORT_ENABLE_ALL
    # As the graph was written: by default, what depends on no earlier step comes first, and leaves the CPU's cache.
    options.execution_order = ort.ExecutionOrder.PRIORITY_BASED
    options.intra_op_num_threads = _physical_cores()
    # Threads that spin between frames would slow down the passes that follow.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.use_deterministic_compute = True
    options.log_severity_level = LOG_NOTHING
    for name, settings in _attempts(chosen, captures):
        wanted = [(available, settings if short_name(available) == name else {})
                  for available in ort.get_available_providers() if short_name(available) in (name, CPU)]
        try:
            with exclusive(name):
                return ort.InferenceSession(str(path), options, providers=wanted, enable_fallback=False)
        except Exception as error:  # onnxruntime's own exceptions share no public base class
            failure = error
    raise ModelError(f"onnxruntime can't load the network ({one_line(failure)})", path,
                     "expected an ONNX graph that this onnxruntime supports")


def _attempts(provider: str, captures: bool) -> Iterator[tuple[str, dict[str, str]]]:
    """Providers that a session is opened on until one works, each with its options."""
    if provider == CUDA:
        load_cuda_libraries()
        options = _cuda_options()
        if captures:  # onnxruntime refuses if a part of the network runs on the CPU
            yield CUDA, {**options, "enable_cuda_graph": "1"}
        yield CUDA, options
    elif provider != CPU:
        yield provider, {}
    yield CPU, {}


def run_options(graph: str) -> ort.RunOptions:
    """Options of a run that is captured as the CUDA graph of that number, if the session captures."""
    options = ort.RunOptions()
    options.log_severity_level = LOG_NOTHING
    options.add_run_config_entry(CUDA_GRAPH, graph)
    return options


def exclusive(provider: str) -> AbstractContextManager[object]:
    """To be entered by whoever uses CUDA: other calls meanwhile would be captured into a graph, or make it fail."""
    return CUDA_LOCK if provider == CUDA else nullcontext()


@cache
def load_cuda_libraries() -> None:
    """Load CUDA and cuDNN from NVIDIA's Python packages, where the dynamic linker does not look."""
    ort.set_default_logger_severity(LOG_NOTHING)  # or it prints what is missing; ``doctor`` says what runs instead
    if packaged_libraries() and hasattr(ort, "preload_dlls"):  # since onnxruntime 1.21
        ort.preload_dlls()


def _cuda_options() -> dict[str, str]:
    """Options of the CUDA provider: a stream that OpenGL's buffers are mapped on, and products in single precision.

    Products of matrices with 10 bits of mantissa (TF32) would put single texels off by 10 % of the brightest light.
    """
    runtime = find_cuda()
    return {"use_tf32": "0", **({} if runtime is None else {"user_compute_stream": str(runtime.stream)})}


def short_name(provider: str) -> str:
    """``CPUExecutionProvider`` as ``cpu``."""
    return provider.removesuffix("ExecutionProvider").lower()


def one_line(error: Exception) -> str:
    """The beginning of an error's message, on one line."""
    return " ".join(str(error).split())[:MAX_REASON_LENGTH]


def _physical_cores() -> int:
    """Cores that this process may use, without hyper-threads, which would share their vector units."""
    try:
        folder = Path("/sys/devices/system/cpu")
        return len({(folder / f"cpu{n}/topology/thread_siblings_list").read_text() for n in os.sched_getaffinity(0)})
    except (OSError, AttributeError):
        return os.cpu_count() or 1
