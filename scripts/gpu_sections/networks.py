"""Ember, world-surfel radiosity, on onnxruntime and torch: times, and errors by precision."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import onnxruntime as ort
import torch

from app.arrays import F32
from app.network.providers import NO_CUDA_GRAPH, load_cuda_libraries, run_options
from app.network.selection import DEFAULT_MODEL, SURFEL_MODEL
from app.paths import nets_dir
from export.models.ember import Ember
from gpu_sections.common import Json, Options, format_size, max_error, mean_error, measure_ms, read_inputs, skipped

CUDA, CPU = "CUDAExecutionProvider", "CPUExecutionProvider"


def network(options: Options) -> Json:
    """Times of onnxruntime on the CPU and torch on the GPU, if any, and errors against torch in double precision."""
    return {format_size(size): _measure(read_inputs(SURFEL_MODEL, size), options) for size in options.sizes}


def onnxruntime_cuda(options: Options) -> Json:
    """Times of onnxruntime's CUDA provider with and without TF32, and errors against its CPU provider."""
    if CUDA not in ort.get_available_providers():
        return skipped(f"this onnxruntime has no {CUDA}")
    load_cuda_libraries()
    rows = {}
    for model, size in product((SURFEL_MODEL, DEFAULT_MODEL), options.sizes):
        inputs, path = read_inputs(model, size), nets_dir() / f"{model}.onnx"
        reference = ort.InferenceSession(path, providers=[CPU]).run(None, inputs)[0]
        for label, settings in {"tf32": {"use_tf32": "1"}, "float32": {"use_tf32": "0"}}.items():
            session = ort.InferenceSession(path, providers=[(CUDA, settings), CPU])
            output = session.run(None, inputs)[0]
            rows[f"{model} {format_size(size)} {label}"] = {
                "runs_on": session.get_providers()[0],
                **measure_ms(partial(session.run, None, inputs), options),
                "max_error": max_error(output, reference),
                "mean_error": mean_error(output, reference)}
        for captures in (False, True):
            rows[f"{model} {format_size(size)} bound, {'captured' if captures else 'node by node'}"] = _measure_bound(
                path, inputs, captures, options)
    return rows


def _measure(inputs: dict[str, F32], options: Options) -> Json:
    cuda = torch.cuda.is_available()
    device = torch.device("cuda" if cuda else "cpu")
    session = ort.InferenceSession(nets_dir() / f"{SURFEL_MODEL}.onnx", providers=[CPU])
    model = Ember().eval().to(device)
    tensors = {name: torch.from_numpy(values).to(device) for name, values in inputs.items()}

    def wait_for(run: Callable[[], object]) -> Callable[[], None]:
        def waiting() -> None:
            run()
            if cuda:
                torch.cuda.synchronize()
        return waiting

    with torch.no_grad():
        reference = Ember().eval().double().to(device)(**{n: t.double() for n, t in tensors.items()})[0].cpu().numpy()
        output = session.run(None, inputs)[0]
        row: Json = {"grid": list(output.shape[2:]), "onnxruntime_error": max_error(output, reference),
                     "onnxruntime_cpu": measure_ms(lambda: session.run(None, inputs), options, 20)}
        for tf32 in (False, True):
            torch.backends.cuda.matmul.allow_tf32 = tf32
            values = model(**tensors)[0].cpu().numpy()
            row[f"torch tf32={tf32}"] = {**measure_ms(wait_for(lambda: model(**tensors)), options),
                                         "max_error": max_error(values, reference),
                                         "mean_error": mean_error(values, reference)}
        torch.backends.cuda.matmul.allow_tf32 = False
        if not cuda:
            return row
        upload = wait_for(lambda: [torch.from_numpy(values).to(device) for values in inputs.values()])
        return {**row, "host_to_device": measure_ms(upload, options)}


def _measure_bound(path: Path, inputs: Mapping[str, F32], captures: bool, options: Options) -> Json:
    """The network between tensors that stay on the GPU, launched node by node or as one CUDA graph."""
    session = ort.InferenceSession(
        path, providers=[(CUDA, {"use_tf32": "0", "enable_cuda_graph": str(int(captures))}), CPU])
    outputs = session.run(None, dict(inputs), run_options(NO_CUDA_GRAPH))
    binding = session.io_binding()
    for name, values in inputs.items():
        binding.bind_ortvalue_input(name, ort.OrtValue.ortvalue_from_numpy(values, "cuda", 0))
    results = [ort.OrtValue.ortvalue_from_numpy(np.zeros_like(values), "cuda", 0) for values in outputs]
    for node, result in zip(session.get_outputs(), results, strict=True):
        binding.bind_ortvalue_output(node.name, result)
    times = measure_ms(lambda: session.run_with_iobinding(binding), options, 100)
    return {**times, "max_difference": max(max_error(result.numpy(), values)
                                           for result, values in zip(results, outputs, strict=True))}
