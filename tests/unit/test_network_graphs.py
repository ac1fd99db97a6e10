"""The graphs of all bundled networks run on CUDA from end to end: no control flow, and a CUDA kernel for each node."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

onnx = pytest.importorskip("onnx")

from onnx import TensorProto, helper  # noqa: E402

from app.network.selection import bundled_models  # noqa: E402

TABLE = json.loads(Path(__file__).with_name("cuda_kernels.json").read_text())
FLOATING = {"float", "float16", "double", "bfloat16"}
CONTROL_FLOW = {"If", "Loop", "Scan"}  # with these, onnxruntime captures no CUDA graph
# The static cache chooses by ``If`` whether to compute what depends on geometry alone.
EXCEPTIONS = {"gfa-8": {"If"}, "gfa-8-half": {"If"}}


def find_problems(model: onnx.ModelProto) -> set[str]:
    """Control flow, and operators without a CUDA kernel for the type they are used with, which follows their name.

    That is the type of the floating tensors around a node or, without any, that of its last input.
    """
    assert [(o.domain, o.version) for o in model.opset_import] == [("", TABLE["opset"])]
    return set(_problems(onnx.shape_inference.infer_shapes(model, strict_mode=True).graph, {}))


def _problems(graph: onnx.GraphProto, outer: dict[str, str]) -> Iterator[str]:
    values = {v.name: v.type for v in (*graph.input, *graph.output, *graph.value_info)}
    types = outer | {name: TensorProto.DataType.Name(t.tensor_type.elem_type).lower() for name, t in values.items()
                     if t.HasField("tensor_type")} | {
                         i.name: TensorProto.DataType.Name(i.data_type).lower() for i in graph.initializer}
    for node in graph.node:
        if node.op_type == "Constant":
            continue
        if node.op_type in CONTROL_FLOW:
            yield node.op_type
            for attribute in node.attribute:
                if attribute.HasField("g"):
                    yield from _problems(attribute.g, types)
            continue
        inputs = [types.get(name, "sequence") for name in node.input if name]
        around = {*inputs, *(types.get(name, "sequence") for name in node.output)}
        for kind in around & FLOATING or inputs[-1:]:
            if kind not in TABLE["kernels"].get(node.op_type, ()):
                yield f"{node.op_type} of {kind}"


@pytest.mark.parametrize("name", bundled_models())
def test_every_node_has_a_cuda_kernel(name: str) -> None:
    assert find_problems(onnx.load(bundled_models()[name])) == EXCEPTIONS.get(name, set())


def test_sequences_and_missing_kernels_are_found() -> None:
    info = helper.make_tensor_value_info
    nodes = [helper.make_node("SplitToSequence", ["x"], ["parts"], axis=1),
             helper.make_node("SequenceAt", ["parts", "first"], ["part"]),
             helper.make_node("Cast", ["part"], ["wide"], to=TensorProto.DOUBLE),
             helper.make_node("Relu", ["wide"], ["y"])]
    branches = [helper.make_graph([helper.make_node("Identity", ["y"], [name])], name, [],
                                  [info(name, TensorProto.DOUBLE, None)]) for name in ("a", "b")]
    nodes.append(helper.make_node("If", ["choice"], ["z"], then_branch=branches[0], else_branch=branches[1]))
    inputs = [info("x", TensorProto.FLOAT, [2, 2]), info("first", TensorProto.INT64, []),
              info("choice", TensorProto.BOOL, [])]
    graph = helper.make_graph(nodes, "bad", inputs, [info("z", TensorProto.DOUBLE, None)])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", TABLE["opset"])])
    assert find_problems(model) == {"SplitToSequence of float", "SequenceAt of float", "Cast of double",
                                    "Relu of double", "If", "Identity of double"}
