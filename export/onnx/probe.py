"""Probe networks that read every channel on every grid, so that golden images cover them all.

Channels of gathered light, which come with surfels of their own, are covered by the case of ``final-gather``.

The output of ``probe.onnx`` is the mean of a texel's screen channels plus the mean of each other tensor. Surfels and
rays have no weight in it, since surfel positions depend on rounding; a separate golden case covers these tensors.
``probe_environment.onnx`` reads the channels of networks that shade an environment, and returns half of the unshadowed
shading.
"""

from pathlib import Path

import onnx
from onnx import TensorProto, helper

from app.golden.catalogue import PROBE, PROBE_ENVIRONMENT
from app.network.channels import (
    CHANNELS,
    CUBE,
    DIFFUSE,
    GATHERED_CHANNELS,
    GLOBALS,
    LIT,
    PANORAMA,
    RAYS,
    SCREEN,
    SPECULAR,
    SURFELS,
    UNSHADOWED_CHANNELS,
)
from app.network.contract import ModelContract, TensorSpec
from export.dataset.network_inputs import make_model

FACE = 16
SURFEL_COUNT, RAYS_PER_SURFEL = 64, 16


def probe_contract() -> ModelContract:
    """All channels that a network for indirect light can read, on every grid; the cube is aligned with the camera."""
    def channels(grid: str) -> tuple[str, ...]:
        return tuple(name for name, c in CHANNELS.items()
                     if grid in c.grids and not c.output and name not in (*UNSHADOWED_CHANNELS, *GATHERED_CHANNELS))

    return ModelContract(
        name="probe", inputs={"screen": TensorSpec(channels(SCREEN)), "cube": TensorSpec(channels(CUBE), CUBE, FACE),
                              "panorama": TensorSpec(channels(PANORAMA), PANORAMA, 2 * FACE),
                              "surfels": TensorSpec(channels(SURFELS), SURFELS, SURFEL_COUNT),
                              "rays": TensorSpec(channels(RAYS), RAYS, SURFEL_COUNT, RAYS_PER_SURFEL),
                              "globals": TensorSpec(channels(GLOBALS), GLOBALS)},
        outputs={"indirect": TensorSpec(("indirect.rgb",))}, scale=1 / 8, multiple_of=4, cube_axes="camera",
        exposure="none", bounces="single", scene_extent=40.0, trained_on="nothing", licence="MIT")


def environment_contract() -> ModelContract:
    """All screen and global channels that a network that shades an environment can read."""
    screen = (name for name, c in CHANNELS.items()
              if SCREEN in c.grids and not c.output
              and name not in (*LIT, *UNSHADOWED_CHANNELS, *GATHERED_CHANNELS))
    return ModelContract(
        name="probe_environment",
        inputs={"unshadowed": TensorSpec(UNSHADOWED_CHANNELS), "screen": TensorSpec(tuple(screen)),
                "globals": TensorSpec(("environment.sh",), GLOBALS)},
        outputs={"light": TensorSpec((DIFFUSE, SPECULAR))}, scale=1 / 4, multiple_of=4, exposure="none",
        bounces="single", scene_extent=40.0, trained_on="nothing", licence="MIT")


def environment_model(spec: ModelContract) -> onnx.ModelProto:
    """The graph whose output is half of the tensor ``unshadowed``; the other inputs have no weight."""
    nodes = [helper.make_node("Mul", ["unshadowed", "half"], ["less"]),
             *(helper.make_node("ReduceMean", [t], [f"mean of {t}"], keepdims=0) for t in ("screen", "globals")),
             helper.make_node("Sum", ["mean of screen", "mean of globals"], ["others"]),
             helper.make_node("Mul", ["others", "nothing"], ["none"]),
             helper.make_node("Add", ["less", "none"], ["light"])]
    constants = [helper.make_tensor(n, TensorProto.FLOAT, [], [v]) for n, v in (("half", 0.5), ("nothing", 0.0))]
    return make_model(spec, nodes, constants)


def probe_model(spec: ModelContract) -> onnx.ModelProto:
    """The graph with ``spec`` as its contract."""
    others = [t for t in spec.inputs if t != "screen"]
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
    return make_model(spec, nodes, shares)


def write_probes() -> tuple[Path, Path]:
    """Write both networks next to the catalogue of golden images."""
    onnx.save(probe_model(probe_contract()), PROBE)
    onnx.save(environment_model(environment_contract()), PROBE_ENVIRONMENT)
    return PROBE, PROBE_ENVIRONMENT
