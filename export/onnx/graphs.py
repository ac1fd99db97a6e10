"""Traces torch modules to ONNX graphs: whole, or split at the static cache (``app.network.static_cache``)."""

import tempfile
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

import onnx
import torch
from onnx import TensorProto, compose, helper
from torch import Tensor, nn

from app.network.channels import SCREEN
from app.network.contract import ModelContract
from app.network.static_cache import PREFIX, PREVIOUS, RECOMPUTE
from export.models.network import Network, StaticSplit

OPSET = 17
_TYPES = {torch.float32: TensorProto.FLOAT, torch.float16: TensorProto.FLOAT16}


def trace_network(network: Network, inputs: Sequence[Tensor]) -> onnx.ModelProto:
    """Trace a network with example ``inputs`` in the contract's order; the screen's h and w stay dynamic."""
    contract = network.contract
    named = dict(zip(contract.inputs, inputs, strict=True))
    if contract.static_input is not None:
        return _trace_split(network, named)
    return _trace(network, named, list(contract.outputs), _dynamic_axes(contract))


class _Precompute(nn.Module):
    def __init__(self, network: StaticSplit) -> None:
        super().__init__()
        self.network = network

    def forward(self, source: Tensor) -> tuple[Tensor, ...]:
        return tuple(self.network.precompute(source))


class _Finish(nn.Module):
    def __init__(self, network: StaticSplit, others: int) -> None:
        super().__init__()
        self.network, self.others = network, others

    def forward(self, *tensors: Tensor) -> Tensor:
        return self.network.finish(tensors[self.others:], *tensors[:self.others])


def _trace_split(network: Network, inputs: Mapping[str, Tensor]) -> onnx.ModelProto:
    """Both halves in one graph: if ``recompute`` is false, inputs replace the results of the first half."""
    contract, halves = network.contract, cast(StaticSplit, network)
    source = contract.static_input
    assert source is not None
    others = {name: x for name, x in inputs.items() if name != source}
    with torch.no_grad():
        cached = {f"{PREFIX}{i}": x for i, x in enumerate(halves.precompute(inputs[source]))}
    axes = _dynamic_axes(contract) | {name: {i: f"{name}.{i}" for i in range(x.dim())} for name, x in cached.items()}
    first = _trace(_Precompute(halves), {source: inputs[source]}, [f"recomputed.{name}" for name in cached], axes)
    second = _trace(_Finish(halves, len(others)), {**others, **cached}, list(contract.outputs), axes)

    first = compose.add_prefix(first, "precompute/", rename_inputs=False, rename_outputs=False)
    types = {name: _TYPES[x.dtype] for name, x in cached.items()}
    copies = {name: f"copied.{name}" for name in cached}
    recompute = helper.make_graph(first.graph.node, "recompute", [], first.graph.output, first.graph.initializer)
    reuse = helper.make_graph(
        [helper.make_node("Identity", [name + PREVIOUS], [copy]) for name, copy in copies.items()], "reuse", [],
        [helper.make_tensor_value_info(copies[name], types[name], [None] * x.dim()) for name, x in cached.items()])
    choice = helper.make_node("If", [RECOMPUTE], list(cached), then_branch=recompute, else_branch=reuse)

    def infos(suffix: str) -> list[onnx.ValueInfoProto]:
        return [helper.make_tensor_value_info(name + suffix, types[name], [None] * x.dim())
                for name, x in cached.items()]

    named = {i.name: i for i in (*first.graph.input, *second.graph.input)}
    flag = helper.make_tensor_value_info(RECOMPUTE, TensorProto.BOOL, [])
    graph = helper.make_graph([choice, *second.graph.node], contract.name,
                              [*(named[name] for name in inputs), flag, *infos(PREVIOUS)],
                              [*second.graph.output, *infos("")], second.graph.initializer)
    return helper.make_model(graph, opset_imports=second.opset_import, ir_version=second.ir_version)


def _trace(module: nn.Module, inputs: Mapping[str, Tensor], outputs: Sequence[str],
           axes: Mapping[str, Mapping[int, str]]) -> onnx.ModelProto:
    module.eval()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        file = Path(folder) / "graph.onnx"
        # The tracing exporter is deprecated, but only it gives a small graph without further packages.
        warnings.simplefilter("ignore")
        torch.onnx.export(module, tuple(inputs.values()), file, dynamo=False, opset_version=OPSET,
                          input_names=list(inputs), output_names=list(outputs),
                          dynamic_axes={name: axes[name] for name in (*inputs, *outputs) if name in axes})
        return onnx.load(file)


def _dynamic_axes(contract: ModelContract) -> dict[str, dict[int, str]]:
    """Axes of variable length, by tensor."""
    return {tensor: {2: "h", 3: "w"} for tensor, spec in (*contract.inputs.items(), *contract.outputs.items())
            if spec.grid == SCREEN}
