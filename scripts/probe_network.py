"""Writes ``app/golden/probe.onnx``: a network that reads every channel on every grid, so that goldens show them all.

Its output is the mean of a texel's screen channels plus the mean of the cube. Run it again when ``app/channels.py``
has a new channel: ``python scripts/probe_network.py``.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import onnx  # noqa: E402
from onnx import TensorProto, helper  # noqa: E402

from app.channels import CHANNELS, CUBE, SCREEN  # noqa: E402
from app.contract import KEY, ModelContract, TensorSpec  # noqa: E402

FACE = 16


def contract() -> ModelContract:
    """Every channel that a network can read, on the screen and on a cube that turns with the camera."""
    def channels(grid: str) -> tuple[str, ...]:
        return tuple(name for name, c in CHANNELS.items() if grid in c.grids and not c.output)

    return ModelContract(
        name="probe", inputs={"screen": TensorSpec(channels(SCREEN)), "cube": TensorSpec(channels(CUBE), CUBE, FACE)},
        outputs={"indirect": TensorSpec(("indirect.rgb",))}, scale=1 / 8, multiple_of=4, cube_axes="camera",
        exposure="mean-radiance", bounces="single", scene_extent=40.0, trained_on="nothing", licence="MIT")


def model(spec: ModelContract) -> onnx.ModelProto:
    """The graph with ``spec`` as its contract."""
    screen, cube = spec.inputs["screen"].components, spec.inputs["cube"].components
    inputs = [helper.make_tensor_value_info("screen", TensorProto.FLOAT, [1, screen, "h", "w"]),
              helper.make_tensor_value_info("cube", TensorProto.FLOAT, [1, cube, 6, FACE, FACE])]
    output = helper.make_tensor_value_info("indirect", TensorProto.FLOAT, [1, 3, "h", "w"])
    nodes = [
        helper.make_node("ReduceMean", ["screen"], ["here"], axes=[1]),
        helper.make_node("ReduceMean", ["cube"], ["around"], axes=[1, 2, 3, 4], keepdims=0),
        helper.make_node("Add", ["here", "around"], ["sum"]),
        helper.make_node("Abs", ["sum"], ["grey"]),
        helper.make_node("Concat", ["grey", "grey", "grey"], ["indirect"], axis=1),
    ]
    graph = helper.make_graph(nodes, "probe", inputs, [output])
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(made, {KEY: spec.to_json()})
    return made


if __name__ == "__main__":
    onnx.save(model(contract()), ROOT / "app" / "golden" / "probe.onnx")
