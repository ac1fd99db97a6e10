"""``export onnx restamp``: contracts of version 1 are updated, and everything else is left alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
onnx = pytest.importorskip("onnx")

from typer.testing import CliRunner  # noqa: E402

from app.errors import ModelError  # noqa: E402
from app.network.contract import KEY  # noqa: E402
from app.network.contract_json import read_contract  # noqa: E402
from app.network.session import Network  # noqa: E402
from export.__main__ import cli  # noqa: E402
from export.models import make_network  # noqa: E402
from export.onnx.export import write_network  # noqa: E402
from export.onnx.restamp import restamp  # noqa: E402
from tests.tiny_network import TINY, write_tiny_network  # noqa: E402

OLD_NAMES = {"surface_and_sky_radiance.rgb": "lumination.rgb", "emissive_irradiance.rgb": "glow.rgb",
             "unshadowed_environment.diffuse.rgb": "coarse.diffuse.rgb",
             "unshadowed_environment.specular.rgb": "coarse.specular.rgb", "globals": "vector",
             "static_input": "kept_from", "recompute": "anew"}


def old_name(name: str) -> str:
    if name.startswith("static."):
        return name.replace("static.", "kept.").replace(".previous", ".before")
    return OLD_NAMES.get(name, name)


def old_json(value: object) -> object:
    """A JSON value with the names of version 1."""
    match value:
        case dict():
            return {old_name(key): old_json(item) for key, item in value.items()}
        case list():
            return [old_json(item) for item in value]
        case str():
            return old_name(value)
        case _:
            return value


def rename_tensors(graph: onnx.GraphProto) -> None:
    for value in (*graph.input, *graph.output, *graph.value_info):
        value.name = old_name(value.name)
    for node in graph.node:
        node.input[:], node.output[:] = map(old_name, node.input), map(old_name, node.output)
        for attribute in node.attribute:
            if attribute.HasField("g"):
                rename_tensors(attribute.g)


def write_version_1(source: Path, path: Path) -> Path:
    """Write the network in ``source`` as an earlier release wrote it."""
    model = onnx.load(source)
    metadata = {p.key: p.value for p in model.metadata_props}
    contract = json.loads(metadata[KEY])
    onnx.helper.set_model_props(model, {**metadata, KEY: json.dumps({**old_json(contract), "version": 1})})
    rename_tensors(model.graph)
    path.write_bytes(model.SerializeToString(deterministic=True))
    return path


@pytest.mark.parametrize("preset", ["ember", "ndr-8", "surround-16"])
def test_restamping_gives_the_file_of_version_2(preset: str, tmp_path: Path) -> None:
    current, _ = write_network(make_network(preset).eval(), tmp_path / "current", (), {})
    old = write_version_1(current, tmp_path / "old.onnx")
    assert old.read_bytes() != current.read_bytes()
    with pytest.raises(ModelError, match="version"):
        read_contract(old)
    restamp(old)
    assert old.read_bytes() == current.read_bytes()


def test_restamping_renames_the_static_cache(tmp_path: Path) -> None:
    size = (16, 8)
    current, _ = write_network(make_network("gfa-8").eval(), tmp_path / "current", (), {})
    old = write_version_1(current, tmp_path / "old.onnx")
    names = {value.name for value in onnx.load(old).graph.input}
    assert {"anew", "kept.0.before"} <= names and not any(name.startswith("static.") for name in names)
    restamp(old)
    assert old.read_bytes() == current.read_bytes()
    network = Network(old, size, provider="cpu")
    rng = np.random.default_rng(0)
    tensors = {name: rng.random((count, *size[::-1]), np.float32) for name, count in (("geometry", 7), ("shading", 6))}
    first, cached = (network.run(tensors)["indirect.rgb"].copy() for _ in range(2))
    assert np.array_equal(first, cached)


def test_other_metadata_is_kept(tmp_path: Path) -> None:
    current, _ = write_network(make_network("gather").eval(), tmp_path / "current", (), {})
    model = onnx.load(write_version_1(current, tmp_path / "old.onnx"))
    onnx.helper.set_model_props(model, {**{p.key: p.value for p in model.metadata_props}, "author": "someone"})
    onnx.save(model, tmp_path / "old.onnx")
    restamp(tmp_path / "old.onnx")
    metadata = {p.key: p.value for p in onnx.load(tmp_path / "old.onnx").metadata_props}
    assert metadata["author"] == "someone" and json.loads(metadata[KEY])["version"] == 2


def test_other_files_are_refused_and_unchanged(tmp_path: Path) -> None:
    current, _ = write_network(make_network("gather").eval(), tmp_path, (), {})
    bare = onnx.load(current)
    del bare.metadata_props[:]
    onnx.save(bare, tmp_path / "bare.onnx")
    (tmp_path / "text.onnx").write_text("not a network")
    for name, message in (("gather.onnx", "no contract of version 1"), ("bare.onnx", "no contract of version 1"),
                          ("text.onnx", "not an ONNX model"), ("missing.onnx", "not an ONNX model")):
        path = tmp_path / name
        content = path.read_bytes() if path.exists() else None
        with pytest.raises(ModelError, match=message) as error:
            restamp(path)
        assert str(error.value).startswith(f"{path}: ") and "\n" not in str(error.value)
        assert content == (path.read_bytes() if path.exists() else None)


def test_the_command_prints_each_file(tmp_path: Path) -> None:
    current, _ = write_network(make_network("gather").eval(), tmp_path, (), {})
    old = write_version_1(current, tmp_path / "old.onnx")
    run = CliRunner().invoke(cli, ["onnx", "restamp", str(old)])
    assert run.exit_code == 0, run.output
    assert run.stdout.strip().replace("\n", "") == str(old)


def restamp_contract(path: Path, contract: dict[str, object]) -> None:
    """Restamp the network in ``path`` with ``contract`` as its contract."""
    model = onnx.load(path)
    onnx.helper.set_model_props(model, {KEY: json.dumps(contract)})
    onnx.save(model, path)
    restamp(path)


@pytest.mark.parametrize("change", [
    {"inputs": None}, {"inputs": []}, {"inputs": {"x": None}}, {"inputs": {"x": []}}, {"inputs": {"x": {}}},
    {"inputs": {"x": {"channels": None}}}, {"inputs": {"x": {"channels": [["direct.rgb"]]}}},
    {"inputs": {"x": {"channels": ["direct.rgb"], "grid": ["screen"]}}}, {"outputs": {"y": 3}}])
def test_a_damaged_contract_is_one_error(change: dict[str, object], tmp_path: Path) -> None:
    path = write_tiny_network(tmp_path / "tiny.onnx")
    with pytest.raises(ModelError, match=r"tiny\.onnx: damaged contract of version 1 \(expected"):
        restamp_contract(path, {**TINY.to_dict(), "version": 1, **change})
    contract = {key: value for key, value in TINY.to_dict().items() if key != "inputs"}
    with pytest.raises(ModelError, match="damaged contract"):
        restamp_contract(path, {**contract, "version": 1})


def test_null_stands_for_an_absent_value(tmp_path: Path) -> None:
    path = write_tiny_network(tmp_path / "tiny.onnx")
    contract = TINY.to_dict()
    inputs = {name: {**spec, "size": None, "rays": None, "grid": None} for name, spec in contract["inputs"].items()}
    restamp_contract(path, {**contract, "inputs": inputs, "version": 1, "kept_from": None, "cube_axes": None})
    assert read_contract(path) == TINY
