"""Times the ways to write a bilateral 3×3 convolution in ONNX: ``python scripts/bilateral_forms.py`` prints a table.

All forms are the same sum; the largest difference from the first one is printed too.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

F32 = NDArray[np.float32]
Nodes = tuple[list[Any], dict[str, NDArray[Any]]]

LAYERS = ((16, 16, 384, 512), (48, 16, 384, 512), (96, 32, 192, 256), (64, 64, 384, 512), (256, 512, 48, 64))
TAPS = [(row, column) for row in range(3) for column in range(3)]
REPEATS = 7
PADS = [1, 1, 1, 1]


def plain(weight: F32) -> Nodes:
    """Without factors, for scale."""
    return [helper.make_node("Conv", ["x", "w"], ["y"], pads=PADS)], {"w": weight}


def slices(weight: F32) -> Nodes:
    """Nine shifted, weighted copies and a 1×1 convolution."""
    outputs, inputs = weight.shape[:2]
    nodes, constants = _shifted()
    constants["w"] = weight.transpose(0, 2, 3, 1).reshape(outputs, 9 * inputs, 1, 1)
    nodes += [helper.make_node("Mul", [f"s{k}", f"m{k}"], [f"p{k}"]) for k in range(9)]
    nodes += [helper.make_node("Concat", [f"p{k}" for k in range(9)], ["c"], axis=1),
              helper.make_node("Conv", ["c", "w"], ["y"])]
    return nodes, constants


def deformable(weight: F32) -> Nodes:
    """``DeformConv`` without offsets, the factors as its mask."""
    return [helper.make_node("Shape", ["x"], ["size"], start=2),
            helper.make_node("Concat", ["two", "size"], ["shape"], axis=0),
            helper.make_node("ConstantOfShape", ["shape"], ["offset"]),
            helper.make_node("DeformConv", ["x", "w", "offset", "", "m"], ["y"], kernel_shape=[3, 3], pads=PADS),
            ], {"w": weight, "two": np.array([1, 18], np.int64)}


def gather(weight: F32) -> Nodes:
    """A one-hot convolution to all neighbours, factors, a 1×1 convolution."""
    outputs, inputs = weight.shape[:2]
    one_hot = np.tile(np.eye(9, dtype=np.float32).reshape(9, 1, 3, 3), (inputs, 1, 1, 1))
    nodes = [helper.make_node("Conv", ["x", "k"], ["n"], group=inputs, pads=PADS), *_times("n", "p"),
             helper.make_node("Conv", ["p", "w"], ["y"])]
    return nodes, {"k": one_hot, "w": weight.reshape(outputs, 9 * inputs, 1, 1), **_shapes(inputs)}


def scatter(weight: F32) -> Nodes:
    """A 1×1 convolution towards all neighbours, factors (they are symmetric), a one-hot convolution."""
    outputs, inputs = weight.shape[:2]
    one_hot = np.tile(np.eye(9, dtype=np.float32)[::-1].reshape(1, 9, 3, 3), (outputs, 1, 1, 1))
    towards = weight[:, :, ::-1, ::-1].transpose(0, 2, 3, 1).reshape(9 * outputs, inputs, 1, 1)
    nodes = [helper.make_node("Conv", ["x", "w"], ["n"]), *_times("n", "p"),
             helper.make_node("Conv", ["p", "k"], ["y"], group=outputs, pads=PADS)]
    return nodes, {"k": one_hot, "w": towards, **_shapes(outputs)}


def nine(weight: F32) -> Nodes:
    """Nine 1×1 convolutions of shifted copies, factors, a sum."""
    nodes, constants = _shifted()
    for k, (row, column) in enumerate(TAPS):
        constants[f"w{k}"] = weight[:, :, row, column][:, :, None, None]
        nodes += [helper.make_node("Conv", [f"s{k}", f"w{k}"], [f"c{k}"]),
                  helper.make_node("Mul", [f"c{k}", f"m{k}"], [f"p{k}"])]
    return [*nodes, helper.make_node("Sum", [f"p{k}" for k in range(9)], ["y"])], constants


FORMS: dict[str, Callable[[F32], Nodes]] = {
    "plain": plain, "slices": slices, "DeformConv": deformable, "gather": gather, "scatter": scatter, "nine": nine}


def _shifted() -> Nodes:
    """``s0`` … ``s8``: the image moved by each tap; ``m0`` … ``m8``: the factors."""
    constants: dict[str, NDArray[Any]] = {"pads": np.array([0, 0, 1, 1, 0, 0, 1, 1]), "axes": np.array([2, 3])}
    nodes = [helper.make_node("Pad", ["x", "pads"], ["padded"]),
             helper.make_node("Split", ["m"], [f"m{k}" for k in range(9)], axis=1, num_outputs=9)]
    for k, tap in enumerate(TAPS):
        constants[f"from{k}"] = np.array(tap)
        constants[f"to{k}"] = np.array([t - 2 if t < 2 else 2**31 for t in tap])
        nodes.append(helper.make_node("Slice", ["padded", f"from{k}", f"to{k}", "axes"], [f"s{k}"]))
    return nodes, constants


def _times(source: str, target: str) -> list[Any]:
    """Channels [1, C · 9, h, w] × factors [1, 9, h, w]."""
    return [helper.make_node("Shape", ["x"], ["size"], start=2),
            helper.make_node("Concat", ["split", "size"], ["shape5"], axis=0),
            helper.make_node("Reshape", [source, "shape5"], ["five"]),
            helper.make_node("Unsqueeze", ["m", "one"], ["m5"]), helper.make_node("Mul", ["five", "m5"], ["weighted"]),
            helper.make_node("Concat", ["joined", "size"], ["shape4"], axis=0),
            helper.make_node("Reshape", ["weighted", "shape4"], [target])]


def _shapes(channels: int) -> dict[str, NDArray[Any]]:
    return {"split": np.array([1, channels, 9]), "joined": np.array([1, 9 * channels]), "one": np.array([1])}


def timed(form: Callable[[F32], Nodes], weight: F32, x: F32, factors: F32) -> tuple[F32, float]:
    """The output, and the least of several times in milliseconds."""
    nodes, constants = form(weight)
    tensors = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, c, "h", "w"])
               for name, c in (("x", weight.shape[1]), ("m", 9), ("y", weight.shape[0]))]
    graph = helper.make_graph(nodes, "form", tensors[:2], tensors[2:],
                              [numpy_helper.from_array(np.ascontiguousarray(v), k) for k, v in constants.items()])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 19)], ir_version=9)
    options = ort.SessionOptions()
    options.log_severity_level = 4
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    session = ort.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        y = session.run(None, {"x": x, "m": factors})[0]
        times.append(1e3 * (time.perf_counter() - start))
    return y, min(times)


def main() -> None:
    """Time every form of every layer."""
    rng = np.random.default_rng(0)
    for inputs, outputs, h, w in LAYERS:
        z = np.pad(rng.random((h, w)), 1).astype(np.float32)
        factors = np.stack([np.exp(-(z[1:-1, 1:-1] - z[r:r + h, c:c + w]) ** 2) for r, c in TAPS])[None]
        x = rng.standard_normal((1, inputs, h, w)).astype(np.float32)
        weight = (rng.standard_normal((outputs, inputs, 3, 3)) / 30).astype(np.float32)
        found = {name: timed(form, weight, x, factors) for name, form in FORMS.items()}
        truth = found["slices"][0]
        off = max(float(np.abs(y - truth).max() / np.abs(truth).max()) for k, (y, _) in found.items() if k != "plain")
        print(f"{inputs:3}→{outputs:3} {w}×{h}: " + ", ".join(f"{k} {ms:.0f} ms" for k, (_, ms) in found.items())
              + f"; off by {off:.0e}", flush=True)


if __name__ == "__main__":
    main()
