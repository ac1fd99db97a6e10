"""The inputs of a network for a pair of frames, rendered by the renderer that will run the network."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper

from app.arrays import F32, Bools
from app.network.channels import SCREEN
from app.network.contract import KEY, ModelContract
from app.network.contract_json import contract_to_json
from app.network.inputs import prepare_inputs
from app.passes.pack_screen import tensor_names
from app.radiance_scale import radiance_scale
from app.renderer import Renderer
from app.settings import Settings
from export.dataset.plan import Pair
from export.dataset.target import nearest_texels
from export.reference.still import Still

TENSOR_TYPES = {"float32": TensorProto.FLOAT, "float16": TensorProto.FLOAT16}
DEPTH_TOLERANCE = 0.03  # relative; as in shaders/taa.frag


@dataclass(frozen=True, eq=False)
class FrameInputs:
    """A network's inputs for one frame.

    Attributes
    ----------
    tensors : mapping of str to ndarray, float32, shape (C, h, w) or (C, 6, n, n)
        As ``app.network.inputs`` prepares them for the network, before padding.
    exposure : float
        The network's inputs and outputs are radiance / exposure, in W/(sr m²); 0 for a black frame.
    """

    tensors: Mapping[str, F32]
    exposure: float


@dataclass(frozen=True, eq=False)
class PairInputs:
    """A network's inputs for two neighbouring frames.

    Attributes
    ----------
    motion : ndarray, float32, shape (2, h, w)
        Motion of each texel's surface since the previous frame, in texels of the screen grid, right and down.
    visible : ndarray, bool, shape (h, w)
        Whether the surface is visible in the previous frame too.
    """

    current: FrameInputs
    previous: FrameInputs
    motion: F32
    visible: Bools


class InputRenderer:
    """Renders the inputs of networks with one contract; a context manager that reuses the renderer of the last scene.

    There is no temporal anti-aliasing and no jitter: networks are trained on single frames.
    """

    def __init__(self, contract: ModelContract) -> None:
        self.contract = contract
        self._outputs = ("direct", "specular") if contract.shades_environment else ("indirect",)
        self._folder = tempfile.TemporaryDirectory()
        self._black_model = Path(self._folder.name) / "black.onnx"
        self._black_model.write_bytes(black_network(contract))
        self._renderer: Renderer | None = None

    def render(self, pair: Pair) -> PairInputs:
        """The inputs for both frames of ``pair``."""
        previous, previous_depth = self._render(self._renderer_for(pair.previous), pair.previous)
        renderer = self._renderer_for(pair.current)
        if pair.previous.scene is not pair.current.scene:  # a light moved
            renderer.advance(pair.previous.camera, pair.previous.time)  # motion vectors need a previous frame
        current, depth = self._render(renderer, pair.current, cut=False)
        motion = renderer.resource("motion")
        rows, columns = nearest_texels(pair.current.size, self.contract.screen_size(pair.current.size))
        motion, previous_depth, depth = (x[rows[:, None], columns] for x in (motion, previous_depth, depth))
        scale = np.array([depth.shape[1], depth.shape[0]], np.float32) / np.array(pair.current.size, np.float32)
        texel_motion = np.moveaxis(motion[..., :2] * scale, -1, 0).astype(np.float32)
        visible = was_visible(previous_depth[..., 0], depth[..., 0] * motion[..., 2], texel_motion)
        return PairInputs(current, previous, texel_motion, visible)

    def render_frame(self, still: Still) -> FrameInputs:
        """The inputs for one frame."""
        return self._render(self._renderer_for(still), still)[0]

    def __enter__(self) -> InputRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        if self._renderer is not None:
            self._renderer.close()
        self._folder.cleanup()

    def _renderer_for(self, still: Still) -> Renderer:
        settings = Settings(still.size, (*self._outputs, "motion", "depth"), taa=False, provider="cpu")
        renderer = self._renderer
        if renderer is None or renderer.scene is not still.scene or renderer.settings != settings:
            if renderer is not None:
                renderer.close()
            renderer = self._renderer = Renderer(still.scene, settings, self._black_model)
        return renderer

    def _render(self, renderer: Renderer, still: Still, cut: bool = True) -> tuple[FrameInputs, F32]:
        """The network's inputs, and the depth at full resolution."""
        if cut:
            renderer.cut()
        renderer.advance(still.camera, still.time)
        packed = {t: renderer.resource(name) for t, name in tensor_names(self.contract).items()}
        tensors = {t: np.empty_like(x) for t, x in packed.items()}
        exposure = prepare_inputs(self.contract, packed, tensors) / radiance_scale(still.scene)
        return FrameInputs(tensors, exposure), renderer.resource("depth")


def was_visible(previous_depth: F32, expected_depth: F32, motion: F32) -> Bools:
    """Where the previous frame shows the surfaces of this frame.

    The previous depth is interpolated as 1 / depth, which is linear on planes and 0 where there is no surface. A value
    between two surfaces therefore rarely matches one of them.

    Parameters
    ----------
    previous_depth : ndarray, shape (h, w)
        Depth in the previous frame; 0 where there is no surface.
    expected_depth : ndarray, shape (h, w)
        Depth of this frame's surfaces in the previous frame; 0 where there is no surface.
    motion : ndarray, shape (2, h, w)
        In texels, right and down.
    """
    h, w = previous_depth.shape
    inverse = np.divide(1, previous_depth, out=np.zeros_like(previous_depth), where=previous_depth > 0)
    x, y = np.arange(w) - motion[0], np.arange(h)[:, None] - motion[1]
    inside = (x >= 0) & (x <= w - 1) & (y >= 0) & (y <= h - 1) & (expected_depth > 0)
    x, y = np.where(inside, x, 0), np.where(inside, y, 0)
    left, top = np.minimum(x.astype(int), max(w - 2, 0)), np.minimum(y.astype(int), max(h - 2, 0))
    right, bottom = np.minimum(left + 1, w - 1), np.minimum(top + 1, h - 1)
    u, v = x - left, y - top
    interpolated = ((1 - v) * ((1 - u) * inverse[top, left] + u * inverse[top, right])
                    + v * ((1 - u) * inverse[bottom, left] + u * inverse[bottom, right]))
    return inside & (np.abs(interpolated * expected_depth - 1) <= DEPTH_TOLERANCE)


def black_network(contract: ModelContract) -> bytes:
    """An ONNX network with these inputs that outputs zeros, so that the renderer prepares the inputs of a real one.

    It has the contract's outputs on the screen only.
    """
    outputs = {t: spec for t, spec in contract.outputs.items() if spec.grid == SCREEN}
    contract = replace(contract, outputs=outputs, static_input=None)  # nothing is cached
    screen = next(t for t, spec in contract.inputs.items() if spec.grid == SCREEN)
    nodes, constants = [], []
    for t, spec in contract.outputs.items():
        shape = spec.components, contract.inputs[screen].components, 1, 1
        zeros = [0.0] * (shape[0] * shape[1])
        constants.append(helper.make_tensor(f"{t}_zero", TENSOR_TYPES[contract.dtype], shape, zeros))
        nodes.append(helper.make_node("Conv", [screen, f"{t}_zero"], [t]))
    return make_model(contract, nodes, constants).SerializeToString()


def make_model(contract: ModelContract, nodes: Sequence[onnx.NodeProto],
               constants: Sequence[onnx.TensorProto]) -> onnx.ModelProto:
    """An ONNX model of hand-made nodes that holds the contract and has its inputs and outputs."""
    inputs, outputs = ([helper.make_tensor_value_info(t, TENSOR_TYPES[contract.dtype],
                                                      [1, spec.components, *spec.extent(("h", "w"))])
                        for t, spec in tensors.items()] for tensors in (contract.inputs, contract.outputs))
    graph = helper.make_graph(nodes, contract.name, inputs, outputs, constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, {KEY: contract_to_json(contract)})
    return model
