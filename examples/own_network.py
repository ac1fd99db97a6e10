"""An own network for indirect light: a third of the light around a texel of direct light, blurred."""

import json
from pathlib import Path

import afterglow
import numpy as np
import onnx
from onnx import helper, numpy_helper

CONTRACT = {"version": 2, "name": "blur", "inputs": {"x": {"channels": ["direct.rgb"], "grid": "screen"}},
            "outputs": {"y": {"channels": ["indirect.rgb"], "grid": "screen"}}, "scale": 0.25, "multiple_of": 1,
            "exposure": "mean-radiance", "bounces": "single", "scene_extent": 40}


def write_network(path: Path) -> Path:
    kernel = np.full((3, 1, 9, 9), 1 / 81 / 3, np.float32)
    x, y = (helper.make_tensor_value_info(name, 1, [1, 3, "h", "w"]) for name in "xy")
    blur = helper.make_node("Conv", ["x", "kernel"], ["y"], group=3, pads=[4, 4, 4, 4])
    graph = helper.make_graph([blur], "blur", [x], [y], [numpy_helper.from_array(kernel, "kernel")])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, {"afterglow": json.dumps(CONTRACT)})
    onnx.save(model, path)
    return path


def main(out: Path = Path(), size: tuple[int, int] = (640, 480)) -> None:
    with afterglow.Renderer(afterglow.load(), size, model=write_network(out / "blur.onnx")) as renderer:
        renderer.render().save(out / "own_network.png")


if __name__ == "__main__":
    main()
