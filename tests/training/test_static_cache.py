"""The static cache of networks: bit-identical output with less work."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")
onnx = pytest.importorskip("onnx")

from app.errors import ModelError  # noqa: E402
from app.network.contract_json import read_contract  # noqa: E402
from app.network.selection import find_model  # noqa: E402
from app.network.session import Network  # noqa: E402
from export.models import make_network  # noqa: E402
from export.onnx.export import stamp, to_half, write_network  # noqa: E402
from export.onnx.sample_inputs import sample_inputs  # noqa: E402

SIZE = (20, 12)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("nets")
    torch.manual_seed(0)
    whole = make_network("gfa-8").eval()
    tolerance = {"float32": 1e-4, "float16": 1e-2}
    return {dtype: write_network(network, folder, sample_inputs(whole.contract),
                                 dict.fromkeys(("room", "random"), tolerance[dtype]), whole)[0]
            for dtype, network in (("float32", whole), ("float16", to_half(whole)))}


def frame(seed: int, light: int) -> dict[str, Any]:
    geometry, shading = (np.random.default_rng(s).random((n, *SIZE[::-1]), np.float32)
                         for s, n in ((seed, 7), (light, 6)))
    return {"geometry": geometry, "shading": shading}


@pytest.mark.parametrize("dtype", ["float32", "float16"])
def test_cached_geometry_changes_nothing(files: dict[str, Path], dtype: str) -> None:
    cached = Network(files[dtype], SIZE, provider="cpu")
    for geometry, light in ((0, 0), (0, 1), (0, 2), (1, 2), (0, 3)):
        uncached = Network(files[dtype], SIZE, provider="cpu")
        expected = uncached.run(frame(geometry, light))["indirect.rgb"]
        assert np.array_equal(cached.run(frame(geometry, light))["indirect.rgb"], expected)
    cached.resize((16, 8))
    assert cached.run({t: x[:, :8, :16] for t, x in frame(0, 3).items()})["indirect.rgb"].shape == (3, 8, 16)


def test_geometry_is_recomputed_only_when_it_changes(files: dict[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    network = Network(files["float32"], SIZE, provider="cpu")
    recomputed: list[bool] = []
    run = network._session.run

    class Spy:
        def run(self, names: list[str], feeds: dict[str, Any], options: Any) -> Any:
            recomputed.append(bool(feeds["recompute"]))
            return run(names, feeds, options)

    monkeypatch.setattr(network, "_session", Spy())
    for geometry, light in ((0, 0), (0, 1), (1, 1), (1, 2), (1, 2)):
        network.run(frame(geometry, light))
    assert recomputed == [True, False, True, False, False]


def test_a_graph_without_a_matching_cache_is_refused(files: dict[str, Path], tmp_path: Path) -> None:
    model = onnx.load(files["float32"])
    broken = onnx.ModelProto()
    broken.CopyFrom(model)
    cached = next(i for i in broken.graph.input if i.name == "static.0.previous")
    cached.type.tensor_type.elem_type = onnx.TensorProto.FLOAT16
    onnx.save(broken, tmp_path / "half.onnx")
    plain = tmp_path / "plain.onnx"
    gather = find_model("gather")
    assert isinstance(gather, Path)
    onnx.save(onnx.load(gather), plain)
    stamp(plain, replace(read_contract(gather), static_input="screen"))
    for path in (tmp_path / "half.onnx", plain):
        with pytest.raises(ModelError) as error:
            Network(path, SIZE, provider="cpu")
        assert "\n" not in str(error.value)


def test_the_contract_names_the_static_input(files: dict[str, Path]) -> None:
    contract = read_contract(files["float32"])
    assert contract.static_input == "geometry"
    with pytest.raises(ModelError, match="static_input 'light'"):
        replace(contract, static_input="light")
    plain = find_model("gather")
    assert isinstance(plain, Path) and read_contract(plain).static_input is None
