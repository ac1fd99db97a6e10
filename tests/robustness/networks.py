"""Networks of a few nodes that do what a network must not do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import onnx
from onnx import TensorProto, helper

from app.network.contract import KEY
from app.network.contract_json import contract_to_json
from tests.tiny_network import TINY

Node = tuple[str, list[str], str]  # operator, inputs, output


def write_network(path: Path, *nodes: Node, dtype: str = "float32", exposure: str = "mean-radiance",
                  **constants: float) -> Path:
    """A network that turns ``light`` [1, 3, h, w], the direct light, into ``y`` of the same shape.

    Parameters
    ----------
    nodes : tuple of str, list of str and str
        Operator, inputs and output, from ``light`` to ``y``.
    constants : float
        Scalars by name.
    """
    kind = {"float32": TensorProto.FLOAT, "float16": TensorProto.FLOAT16}[dtype]
    inputs = [helper.make_tensor_value_info("x", kind, [1, 6, "h", "w"])]
    outputs = [helper.make_tensor_value_info("y", kind, [1, 3, None, None])]
    initializers = [helper.make_tensor(n, TensorProto.INT64, [1], [v])
                    for n, v in (("zero", 0), ("three", 3), ("channels", 1))]
    initializers += [helper.make_tensor(n, kind, [], [v]) for n, v in constants.items()]
    graph = helper.make_graph(
        [helper.make_node("Slice", ["x", "zero", "three", "channels"], ["light"]),
         *(helper.make_node(operator, names, [output]) for operator, names, output in nodes)],
        "odd", inputs, outputs, initializers)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, {KEY: contract_to_json(replace(TINY, dtype=dtype, exposure=exposure))})
    onnx.save(model, path)
    return path


def constant(path: Path, value: float) -> Path:
    """A network that returns ``value`` everywhere, whatever it is fed."""
    return write_network(path, ("Mul", ["light", "none"], "black"), ("Add", ["black", "value"], "y"),
                         none=0.0, value=value)
