"""Probe networks, which read every channel on every grid, so that golden images show them all.

The output of ``probe.onnx`` is the mean of a texel's screen channels plus the mean of each other tensor. Surfels and rays
count nothing in it, since where surfels lie depends on rounding; a golden case of its own shows these tensors.
``probe_environment.onnx`` reads what networks may that shade an environment, and gives half of the unshadowed shading.
"""

from __future__ import annotations

from pathlib import Path

import onnx
from onnx import TensorProto, helper

from app.golden.catalogue import PROBE, PROBE_ENVIRONMENT
from app.network.channels import (
    CHANNELS,
    CUBE,
    DIFFUSE,
    GLOBALS,
    LIT,
    PANORAMA,
    RAYS,
    SCREEN,
    SPECULAR,
    SURFELS,
    UNSHADOWED_CHANNELS,
)
from app.network.contract import KEY, ModelContract, TensorSpec

FACE = 16
COUNT, K = 64, 16  # surfels, and rays of each


def contract() -> ModelContract:
    """Every channel that a network for indirect light can read, on every grid; the cube turns with the camera."""
    def channels(grid: str) -> tuple[str, ...]:
        return tuple(name for name, c in CHANNELS.items()
                     if grid in c.grids and not c.output and name not in UNSHADOWED_CHANNELS)

    return ModelContract(
        name="probe", inputs={"screen": TensorSpec(channels(SCREEN)), "cube": TensorSpec(channels(CUBE), CUBE, FACE),
                              "panorama": TensorSpec(channels(PANORAMA), PANORAMA, 2 * FACE),
                              "surfels": TensorSpec(channels(SURFELS), SURFELS, COUNT),
                              "rays": TensorSpec(channels(RAYS), RAYS, COUNT, K),
                              "globals": TensorSpec(channels(GLOBALS), GLOBALS)},
        outputs={"indirect": TensorSpec(("indirect.rgb",))}, scale=1 / 8, multiple_of=4, cube_axes="camera",
        exposure="none", bounces="single", scene_extent=40.0, trained_on="nothing", licence="MIT")


def environment_contract() -> ModelContract:
    """Every channel of the screen and of the frame that a network can read which shades an environment."""
    screen = (name for name, c in CHANNELS.items()
              if SCREEN in c.grids and not c.output and name not in (*LIT, *UNSHADOWED_CHANNELS))
    return ModelContract(
        name="probe_environment", inputs={"unshadowed": TensorSpec(UNSHADOWED_CHANNELS), "screen": TensorSpec(tuple(screen)),
                                          "globals": TensorSpec(("environment.sh",), GLOBALS)},
        outputs={"light": TensorSpec((DIFFUSE, SPECULAR))}, scale=1 / 4, multiple_of=4, exposure="none",
        bounces="single", scene_extent=40.0, trained_on="nothing", licence="MIT")


def environment_model(spec: ModelContract) -> onnx.ModelProto:
    """Half of the tensor ``unshadowed``; the others count nothing."""
    shapes = {t: [1, s.components, *s.extent(("h", "w"))] for t, s in {**spec.inputs, **spec.outputs}.items()}
    values = [helper.make_tensor_value_info(t, TensorProto.FLOAT, shape) for t, shape in shapes.items()]
    nodes = [helper.make_node("Mul", ["unshadowed", "half"], ["less"]),
             *(helper.make_node("ReduceMean", [t], [f"mean of {t}"], keepdims=0) for t in ("screen", "globals")),
             helper.make_node("Sum", ["mean of screen", "mean of globals"], ["others"]),
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


def write_probes() -> tuple[Path, Path]:
    """Write both networks beside the catalogue of golden images."""
    onnx.save(model(contract()), PROBE)
    onnx.save(environment_model(environment_contract()), PROBE_ENVIRONMENT)
    return PROBE, PROBE_ENVIRONMENT
