"""Torch modules as ONNX graphs: whole, or split where work may be cached (``app.network.static_cache``)."""

from __future__ import annotations

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


def graph_of(network: Network, inputs: Sequence[Tensor]) -> onnx.ModelProto:
    """The graph of a network whose contract's inputs are like ``inputs``; h and w of the screen may be any."""
    contract = network.contract
    named = dict(zip(contract.inputs, inputs, strict=True))
    if contract.static_input is not None:
        return _split(network, named)
    return _traced(network, named, list(contract.outputs), _free(contract))


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


def _split(network: Network, inputs: Mapping[str, Tensor]) -> onnx.ModelProto:
    """Both halves in one graph: the first runs where ``recompute`` is true, otherwise its results are inputs."""
    contract, halves = network.contract, cast(StaticSplit, network)
    source = contract.static_input
    assert source is not None
    others = {name: x for name, x in inputs.items() if name != source}
    with torch.no_grad():
        cached = {f"{PREFIX}{i}": x for i, x in enumerate(halves.precompute(inputs[source]))}
    free = _free(contract) | {name: {axis: f"{name}.{axis}" for axis in range(x.dim())} for name, x in cached.items()}
    first = _traced(_Precompute(halves), {source: inputs[source]}, [f"recomputed.{name}" for name in cached], free)
    second = _traced(_Finish(halves, len(others)), {**others, **cached}, list(contract.outputs), free)

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


def _traced(module: nn.Module, inputs: Mapping[str, Tensor], outputs: Sequence[str],
            free: Mapping[str, Mapping[int, str]]) -> onnx.ModelProto:
    module.eval()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        file = Path(folder) / "graph.onnx"
        # The tracing exporter is deprecated, but alone gives a small graph without further packages.
        warnings.simplefilter("ignore")
        torch.onnx.export(module, tuple(inputs.values()), file, dynamo=False, opset_version=OPSET,
                          input_names=list(inputs), output_names=list(outputs),
                          dynamic_axes={name: free[name] for name in (*inputs, *outputs) if name in free})
        return onnx.load(file)


def _free(contract: ModelContract) -> dict[str, dict[int, str]]:
    """Axes of any length, by tensor."""
    return {tensor: {2: "h", 3: "w"} for tensor, spec in (*contract.inputs.items(), *contract.outputs.items())
            if spec.grid == SCREEN}
