"""The smallest useful network, with other inputs than the bundled ones: half the mean direct light, everywhere."""

from __future__ import annotations

from pathlib import Path

import onnx
from onnx import TensorProto, helper

from app.network.contract import KEY, ModelContract, TensorSpec
from app.network.contract_json import contract_to_json

TINY = ModelContract(
    name="tiny", inputs={"x": TensorSpec(("direct.rgb", "normal.world.xyz"))},
    outputs={"y": TensorSpec(("indirect.rgb",))}, scale=1 / 8, multiple_of=4, exposure="mean-radiance",
    bounces="single", scene_extent=40.0, licence="MIT")


def write_tiny_network(path: Path, contract: str | None = contract_to_json(TINY), channels: int = 6,
                       output_width: str = "w") -> Path:
    """Write the network with any text as its contract.

    Parameters
    ----------
    contract : str or None
        Metadata value; None writes none.
    channels : int
        Of the graph's input.
    output_width : str
        ``w``, or ``first`` for an output that has the right shape only while the input's first value is 0.
    """
    x = helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, channels, "h", "w"])
    y = helper.make_tensor_value_info("y", TensorProto.FLOAT, [1, 3, "h", None])
    nodes = [
        helper.make_node("Slice", ["x", "zero", "three", "one"], ["light"]),
        helper.make_node("ReduceMean", ["light"], ["mean"], axes=[2, 3]),
        helper.make_node("Mul", ["mean", "half"], ["ambient"]),
        helper.make_node("Mul", ["light", "none"], ["black"]),
        helper.make_node("Add", ["black", "ambient"], ["everywhere" if output_width == "first" else "y"]),
    ]
    if output_width == "first":
        nodes += [
            helper.make_node("ReduceMax", ["light"], ["largest"], keepdims=0),
            helper.make_node("Sign", ["largest"], ["lit"]),
            helper.make_node("Cast", ["lit"], ["skip"], to=TensorProto.INT64),
            helper.make_node("Reshape", ["skip", "one"], ["begin"]),
            helper.make_node("Slice", ["everywhere", "begin", "many", "last"], ["y"]),
        ]
    constants = [helper.make_tensor(n, TensorProto.INT64, [1], [v])
                 for n, v in (("zero", 0), ("three", 3), ("one", 1), ("last", 3), ("many", 1 << 30))]
    constants += [helper.make_tensor(n, TensorProto.FLOAT, [], [v]) for n, v in (("half", 0.5), ("none", 0.0))]
    graph = helper.make_graph(nodes, "tiny", [x], [y], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    if contract is not None:
        helper.set_model_props(model, {KEY: contract})
    onnx.save(model, path)
    return path
