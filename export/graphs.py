"""Torch modules as ONNX graphs: whole, or split where work may be kept from frame to frame (``app/kept.py``)."""

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

from app.channels import SCREEN
from app.contract import ModelContract
from app.kept import ANEW, BEFORE, PREFIX
from export.models.network import Network, Splits

OPSET = 17
_TYPES = {torch.float32: TensorProto.FLOAT, torch.float16: TensorProto.FLOAT16}


def graph_of(network: Network, inputs: Sequence[Tensor]) -> onnx.ModelProto:
    """The graph of a network whose contract's inputs are like ``inputs``; h and w of the screen may be any."""
    contract = network.contract
    named = dict(zip(contract.inputs, inputs, strict=True))
    if contract.kept_from is not None:
        return _split(network, named)
    return _traced(network, named, list(contract.outputs), _free(contract))


class _Keep(nn.Module):
    def __init__(self, network: Splits) -> None:
        super().__init__()
        self.network = network

    def forward(self, source: Tensor) -> tuple[Tensor, ...]:
        return tuple(self.network.keep(source))


class _Resume(nn.Module):
    def __init__(self, network: Splits, others: int) -> None:
        super().__init__()
        self.network, self.others = network, others

    def forward(self, *tensors: Tensor) -> Tensor:
        return self.network.resume(tensors[self.others:], *tensors[:self.others])


def _split(network: Network, inputs: Mapping[str, Tensor]) -> onnx.ModelProto:
    """Both halves in one graph; the first runs where ``anew`` says so, and what came of it is given in otherwise."""
    contract, splits = network.contract, cast(Splits, network)
    source = contract.kept_from
    assert source is not None
    others = {name: x for name, x in inputs.items() if name != source}
    with torch.no_grad():
        kept = {f"{PREFIX}{i}": x for i, x in enumerate(splits.keep(inputs[source]))}
    free = _free(contract) | {name: {axis: f"{name}.{axis}" for axis in range(x.dim())} for name, x in kept.items()}
    first = _traced(_Keep(splits), {source: inputs[source]}, [f"anew.{name}" for name in kept], free)
    second = _traced(_Resume(splits, len(others)), {**others, **kept}, list(contract.outputs), free)

    first = compose.add_prefix(first, "keep/", rename_inputs=False, rename_outputs=False)
    before = [f"given.{name}" for name in kept]
    given = [helper.make_node("Identity", [name + BEFORE], [out]) for name, out in zip(kept, before, strict=True)]
    types = {name: _TYPES[x.dtype] for name, x in kept.items()}
    anew = helper.make_graph(first.graph.node, "anew", [], first.graph.output, first.graph.initializer)
    kept_as_is = helper.make_graph(given, "given", [], [
        helper.make_tensor_value_info(out, types[name], [None] * x.dim())
        for out, (name, x) in zip(before, kept.items(), strict=True)])
    choice = helper.make_node("If", [ANEW], list(kept), then_branch=anew, else_branch=kept_as_is)

    def infos(suffix: str) -> list[onnx.ValueInfoProto]:
        return [helper.make_tensor_value_info(name + suffix, types[name], [None] * x.dim()) for name, x in kept.items()]

    found = {i.name: i for i in (*first.graph.input, *second.graph.input)}
    graph = helper.make_graph(
        [choice, *second.graph.node], contract.name,
        [*(found[name] for name in inputs), helper.make_tensor_value_info(ANEW, TensorProto.BOOL, []), *infos(BEFORE)],
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
