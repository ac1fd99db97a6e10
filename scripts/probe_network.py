"""Writes ``app/golden/probe.onnx``: a network that reads every channel on every grid, so that goldens show them all.

Its output is the mean of a texel's screen channels plus the mean of each other tensor; that of surfels and rays counts
nothing, since where surfels lie hangs on rounding, and a golden of its own shows these tensors.
``probe_environment.onnx`` reads what networks may that shade an environment, and gives half the coarse shading. Run it
again when ``app/channels.py`` has a new channel: ``python scripts/probe_network.py``.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import onnx
from onnx import TensorProto, helper

from app.channels import (
    CHANNELS,
    COARSE_CHANNELS,
    CUBE,
    DIFFUSE,
    LIT,
    PANORAMA,
    RAYS,
    SCREEN,
    SPECULAR,
    SURFELS,
    VECTOR,
)
from app.contract import KEY, ModelContract, TensorSpec

FACE = 16
COUNT, K = 64, 16  # surfels, and rays of each


def contract() -> ModelContract:
    """Every channel that a network for indirect light can read, on every grid; the cube turns with the camera."""
    def channels(grid: str) -> tuple[str, ...]:
        return tuple(name for name, c in CHANNELS.items()
                     if grid in c.grids and not c.output and name not in COARSE_CHANNELS)

    return ModelContract(
        name="probe", inputs={"screen": TensorSpec(channels(SCREEN)), "cube": TensorSpec(channels(CUBE), CUBE, FACE),
                              "panorama": TensorSpec(channels(PANORAMA), PANORAMA, 2 * FACE),
                              "surfels": TensorSpec(channels(SURFELS), SURFELS, COUNT),
                              "rays": TensorSpec(channels(RAYS), RAYS, COUNT, K),
                              "vector": TensorSpec(channels(VECTOR), VECTOR)},
        outputs={"indirect": TensorSpec(("indirect.rgb",))}, scale=1 / 8, multiple_of=4, cube_axes="camera",
        exposure="none", bounces="single", scene_extent=40.0, trained_on="nothing", licence="MIT")


def environment_contract() -> ModelContract:
    """Every channel of the screen and of the frame that a network can read which shades an environment."""
    screen = (name for name, c in CHANNELS.items()
              if SCREEN in c.grids and not c.output and name not in (*LIT, *COARSE_CHANNELS))
    return ModelContract(
        name="probe_environment", inputs={"coarse": TensorSpec(COARSE_CHANNELS), "screen": TensorSpec(tuple(screen)),
                                          "vector": TensorSpec(("environment.sh",), VECTOR)},
        outputs={"light": TensorSpec((DIFFUSE, SPECULAR))}, scale=1 / 4, multiple_of=4, exposure="none",
        bounces="single", scene_extent=40.0, trained_on="nothing", licence="MIT")


def environment_model(spec: ModelContract) -> onnx.ModelProto:
    """Half of the tensor ``coarse``; the others count nothing."""
    shapes = {t: [1, s.components, *s.extent(("h", "w"))] for t, s in {**spec.inputs, **spec.outputs}.items()}
    values = [helper.make_tensor_value_info(t, TensorProto.FLOAT, shape) for t, shape in shapes.items()]
    nodes = [helper.make_node("Mul", ["coarse", "half"], ["less"]),
             *(helper.make_node("ReduceMean", [t], [f"mean of {t}"], keepdims=0) for t in ("screen", "vector")),
             helper.make_node("Sum", ["mean of screen", "mean of vector"], ["others"]),
             helper.make_node("Mul", ["others", "nothing"], ["none"]),
             helper.make_node("Add", ["less", "none"], ["light"])]
    constants = [helper.make_tensor(n, TensorProto.FLOAT, [], [v]) for n, v in (("half", 0.5), ("nothing", 0.0))]
    return _made(helper.make_graph(nodes, "probe", values[:-1], values[-1:], constants), spec)


def model(spec: ModelContract) -> onnx.ModelProto:
    """The graph with ``spec`` as its contract."""
    shapes = {t: [1, s.components, *s.extent(("h", "w"))] for t, s in spec.inputs.items()}
    inputs = [helper.make_tensor_value_info(t, TensorProto.FLOAT, shape) for t, shape in shapes.items()]
    output = helper.make_tensor_value_info("indirect", TensorProto.FLOAT, [1, 3, "h", "w"])
    others = [t for t in shapes if t != "screen"]
    nodes = [
        helper.make_node("ReduceMean", ["screen"], ["here"], axes=[1]),
        *(helper.make_node("ReduceMean", [t], [f"all of {t}"], keepdims=0) for t in others),
        *(helper.make_node("Mul", [f"all of {t}", f"share of {t}"], [f"mean of {t}"]) for t in others),
        helper.make_node("Sum", ["here", *(f"mean of {t}" for t in others)], ["sum"]),
        helper.make_node("Abs", ["sum"], ["grey"]),
        helper.make_node("Concat", ["grey", "grey", "grey"], ["indirect"], axis=1),
    ]
    shares = [helper.make_tensor(f"share of {t}", TensorProto.FLOAT, [], [float(spec.inputs[t].face is not None)])
              for t in others]
    return _made(helper.make_graph(nodes, "probe", inputs, [output], shares), spec)


def _made(graph: onnx.GraphProto, spec: ModelContract) -> onnx.ModelProto:
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(made, {KEY: spec.to_json()})
    return made


if __name__ == "__main__":
    onnx.save(model(contract()), ROOT / "app" / "golden" / "probe.onnx")
    onnx.save(environment_model(environment_contract()), ROOT / "app" / "golden" / "probe_environment.onnx")
