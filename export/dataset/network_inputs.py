"""What a network is given for a pair of frames: drawn, picked, packed and exposed by the renderer that will run it."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper

from app.gl.lights import radiance_scale
from app.network.channels import SCREEN
from app.network.contract import KEY, ModelContract
from app.network.session import feed
from app.passes.pack_screen import tensor_names
from app.renderer import Renderer
from app.settings import Settings
from export.dataset.nearest_texels import picked

if TYPE_CHECKING:
    from export.dataset import Pair
    from export.reference.still import Still

F32 = NDArray[np.float32]
Tensors = Mapping[str, F32]

DEPTH_TOLERANCE = 0.03  # relative; as in shaders/taa.frag


@dataclass(frozen=True, eq=False)
class Frame:
    """A network's inputs for one frame.

    Attributes
    ----------
    tensors : mapping of str to ndarray, float32, shape (C, h, w) or (C, 6, n, n)
        As ``app.network.session`` gives them to the network, before padding.
    exposure : float
        W/(sr m²): radiance / this is what the network sees and what it is to give; 0 when the frame is black.
    """

    tensors: Tensors
    exposure: float


@dataclass(frozen=True, eq=False)
class Inputs:
    """Two neighbouring frames.

    Attributes
    ----------
    motion : ndarray, float32, shape (2, h, w)
        Texels of the screen grid that a surface moved by since the previous frame, right and down.
    visible : ndarray of bool, shape (h, w)
        Whether the previous frame shows that surface too.
    """

    current: Frame
    previous: Frame
    motion: F32
    visible: NDArray[np.bool_]


class Drawer:
    """Draws pairs for one contract; a context manager that keeps the renderer of the newest scene.

    No temporal anti-aliasing and no jitter: a network is trained on what one frame shows.
    """

    def __init__(self, contract: ModelContract) -> None:
        self.contract = contract
        self._wanted = ("direct", "specular") if contract.shades_environment else ("indirect",)
        self._folder = tempfile.TemporaryDirectory()
        self._black = Path(self._folder.name) / "black.onnx"
        self._black.write_bytes(_black_network(contract))
        self._renderer: Renderer | None = None

    def draw(self, pair: Pair) -> Inputs:
        """The inputs for both frames of ``pair``."""
        if pair.previous.scene is pair.current.scene:
            renderer = self._renderer_of(pair.current)
            previous, depth = self._frame(renderer, pair.previous)
        else:  # a light moved
            previous, depth = self._frame(self._renderer_of(pair.previous), pair.previous)
            renderer = self._renderer_of(pair.current)
            renderer.advance(pair.previous.camera, pair.previous.time)  # motion needs a frame before
        current, depth_now = self._frame(renderer, pair.current, cut=False)
        motion = renderer.resource("motion")
        rows, columns = picked(pair.current.size, self.contract.screen_size(pair.current.size))
        motion, depth, depth_now = (x[rows[:, None], columns] for x in (motion, depth, depth_now))
        scale = np.array([depth.shape[1], depth.shape[0]], np.float32) / np.array(pair.current.size, np.float32)
        moved = np.moveaxis(motion[..., :2] * scale, -1, 0).astype(np.float32)
        visible = seen_before(depth[..., 0], depth_now[..., 0] * motion[..., 2], moved)
        return Inputs(current, previous, moved, visible)

    def still(self, still: Still) -> Frame:
        """The inputs for one frame."""
        return self._frame(self._renderer_of(still), still)[0]

    def close(self) -> None:
        """Give the renderer back."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
        self._folder.cleanup()

    def __enter__(self) -> Drawer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _renderer_of(self, still: Still) -> Renderer:
        settings = Settings(still.size, (*self._wanted, "motion", "depth"), taa=False, provider="cpu")
        kept = self._renderer
        if kept is None or kept.scene is not still.scene or kept.settings != settings:
            if kept is not None:
                kept.close()
            self._renderer = Renderer(still.scene, settings, self._black)
        assert self._renderer is not None
        return self._renderer

    def _frame(self, renderer: Renderer, still: Still, cut: bool = True) -> tuple[Frame, F32]:
        """The network's inputs and the depth at full size."""
        if cut:
            renderer.cut()
        renderer.advance(still.camera, still.time)
        packed = {t: renderer.resource(name) for t, name in tensor_names(self.contract).items()}
        tensors = {t: np.empty_like(x) for t, x in packed.items()}
        exposure = feed(self.contract, packed, tensors) / radiance_scale(still.scene)
        return Frame(tensors, exposure), renderer.resource("depth")


def draw(pair: Pair, contract: ModelContract) -> Inputs:
    """The inputs of one pair; ``Drawer`` is quicker for many."""
    with Drawer(contract) as drawer:
        return drawer.draw(pair)


def seen_before(previous: F32, expected: F32, motion: F32) -> NDArray[np.bool_]:
    """Where a surface was in sight in the previous frame.

    Its place there is interpolated from 1 / depth, which is linear over a plane and 0 in the sky, so that nothing
    between two surfaces passes for one of them.

    Parameters
    ----------
    previous : ndarray, shape (h, w)
        Depth in the previous frame, 0 in the sky.
    expected : ndarray, shape (h, w)
        Depth that the texel's surface had there; 0 in the sky.
    motion : ndarray, shape (2, h, w)
        In texels, right and down.
    """
    h, w = previous.shape
    inverse = np.divide(1, previous, out=np.zeros_like(previous), where=previous > 0)
    x, y = np.arange(w) - motion[0], np.arange(h)[:, None] - motion[1]
    inside = (x >= 0) & (x <= w - 1) & (y >= 0) & (y <= h - 1) & (expected > 0)
    x, y = np.where(inside, x, 0), np.where(inside, y, 0)
    left, top = np.minimum(x.astype(int), max(w - 2, 0)), np.minimum(y.astype(int), max(h - 2, 0))
    right, bottom = np.minimum(left + 1, w - 1), np.minimum(top + 1, h - 1)
    u, v = x - left, y - top
    found = ((1 - v) * ((1 - u) * inverse[top, left] + u * inverse[top, right])
             + v * ((1 - u) * inverse[bottom, left] + u * inverse[bottom, right]))
    return inside & (np.abs(found * expected - 1) <= DEPTH_TOLERANCE)


def _black_network(contract: ModelContract) -> bytes:
    """A network of this contract that gives no light: it lets the renderer draw what a real one would read."""
    kind = {"float32": TensorProto.FLOAT, "float16": TensorProto.FLOAT16}[contract.dtype]

    def values(tensors: Mapping[str, Any]) -> list[onnx.ValueInfoProto]:
        return [helper.make_tensor_value_info(t, kind, [1, s.components, *s.extent(("h", "w"))])
                for t, s in tensors.items()]

    screen = next(t for t, spec in contract.inputs.items() if spec.grid == SCREEN)
    nodes, constants = [], []
    for t, spec in contract.outputs.items():
        shape = spec.components, contract.inputs[screen].components, 1, 1
        constants.append(helper.make_tensor(f"{t}_none", kind, shape, [0.0] * (shape[0] * shape[1])))
        nodes.append(helper.make_node("Conv", [screen, f"{t}_none"], [t]))
    graph = helper.make_graph(nodes, "black", values(contract.inputs), values(contract.outputs), constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, {KEY: replace(contract, static_input=None).to_json()})  # it has nothing to keep
    return model.SerializeToString()
