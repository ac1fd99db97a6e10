"""The contract: what is accepted, and what each mistake says."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from app.errors import ModelError
from app.network.contract import ModelContract
from app.network.contract_json import contract_from_json, contract_to_json, read_contract
from app.network.selection import HALF_SUFFIX, SSGI, bundled_models, find_model
from tests.tiny_network import TINY, write_tiny_network


def changed(**changes: Any) -> str:
    return json.dumps({**json.loads(contract_to_json(TINY)), **changes})


def with_tensor(group: str, **changes: Any) -> str:
    value = json.loads(contract_to_json(TINY))
    next(iter(value[group].values())).update(changes)
    return json.dumps(value)


def without(key: str) -> str:
    return json.dumps({k: v for k, v in json.loads(contract_to_json(TINY)).items() if k != key})


def test_json_and_back_is_the_same() -> None:
    assert contract_from_json(contract_to_json(TINY), "here") == TINY


def test_bundled_networks_have_valid_contracts_and_cards() -> None:
    assert {"ember", "gather", "radiosity"} <= set(bundled_models())
    for name, path in bundled_models().items():
        contract = read_contract(path)
        assert contract.name == name and contract.licence
        assert path.with_name(f"{name.removesuffix(HALF_SUFFIX)}.md").is_file()
        assert find_model(name) == path


def test_the_screen_grid_is_never_empty() -> None:
    contract = read_contract(find_model("radiosity"))
    assert contract.screen_size((1024, 768)) == (64, 48)
    assert contract.screen_size((256, 192)) == (64, 48)  # small images keep 48 texels
    assert contract.screen_size((1, 17)) == (1, 9)  # up to half of them


@pytest.mark.parametrize(("text", "message"), [
    ("{", "here: the contract is no JSON"),
    ("[]", "here: wrong kind of value [] (expected an object)"),
    (changed(version=3), "here: contract version 3 (expected version 2)"),
    (changed(version=1), "expected version 2, which python -m export onnx restamp here makes of version 1"),
    (without("version"), "contract version None"),
    (changed(sclae=0.5), "here: sclae: unknown key 'sclae' (did you mean 'scale'? expected one of: bounces, "),
    (without("scale"), "here: missing key 'scale'"),
    (changed(scale=0), "here: scale: 0 is out of range (expected more than 0)"),
    (changed(scale=1.5), "here: scale: 1.5 is out of range"),
    (changed(scale="half"), 'here: scale: wrong kind of value "half"'),
    (changed(scale=True), "here: scale: wrong kind of value true"),
    (changed().replace("0.125", "NaN"), "NaN is no number"),
    (changed(multiple_of=0), "here: multiple_of: 0 is out of range"),
    (changed(multiple_of=1.5), "here: multiple_of: wrong kind of value 1.5"),
    (changed(scene_extent=-1), "here: scene_extent: -1 is out of range"),
    (changed(dtype="int8"), "here: dtype: unknown value 'int8' (expected one of: float32, float16)"),
    (changed(exposure="auto"), "here: exposure: unknown value 'auto' (expected one of: mean-radiance, none)"),
    (changed(bounces=3), "here: bounces: unknown value 3"),
    (changed(name=3), "here: name: wrong kind of value 3"),
    (changed(inputs={}), "here: inputs: 0 values (expected at least 1)"),
    (changed(inputs=["x"]), "here: inputs: wrong kind of value"),
    (changed(inputs={"x": 3}), "here: inputs.x: wrong kind of value 3"),
    (changed(inputs={"x": None}), "here: inputs.x: wrong kind of value null"),
    (changed(inputs=None), "here: missing key 'inputs'"),
    (changed(static_input="y"), "here: static_input 'y' is no input (expected one of: x)"),
    (with_tensor("inputs", channels=["direct.rgb", "normal.world.xzy"]),
     "here: unknown channel 'normal.world.xzy' of tensor 'x' (did you mean 'normal.world.xyz'? expected one of: "),
    (with_tensor("inputs", channels="direct.rgb"), "here: inputs.x.channels: wrong kind of value"),
    (with_tensor("inputs", channels=[]), "here: inputs.x.channels: 0 values"),
    (with_tensor("inputs", grid="sphere"), "here: inputs.x.grid: unknown value 'sphere'"),
    (with_tensor("inputs", size=8), "here: bad size 8 of tensor 'x' (expected no size on the grid screen)"),
    (with_tensor("inputs", gird="cube"), "unknown key 'gird' (did you mean 'grid'? expected one of: "),
    (with_tensor("inputs", grid="cube"), "here: bad size None"),
    (with_tensor("inputs", grid="cube", size=1025), "here: bad size 1025 of tensor 'x' (expected a size of at "),
    (with_tensor("inputs", grid="cube", size=8), "here: no cube_axes"),
    (with_tensor("inputs", grid="globals", size=8), "here: bad size 8"),
    (with_tensor("inputs", grid="globals"), "does not exist on the grid globals"),
    (with_tensor("inputs", grid="panorama", size=18), "here: panorama 'x' is 18 high"),
    (with_tensor("inputs", grid="panorama", size=16), "here: no cube_axes"),
    (changed(cube_axes="world", inputs={
        "x": {"channels": ["depth"]}, "c": {"channels": ["depth"], "grid": "cube", "size": 16},
        "p": {"channels": ["depth"], "grid": "panorama", "size": 16}}), "different cube face sizes [8, 16]"),
    (with_tensor("inputs", channels=["on_screen"]),
     "here: channel 'on_screen' of tensor 'x' does not exist on the grid screen"),
    (with_tensor("inputs", channels=["indirect.rgb"]), "here: channel 'indirect.rgb' of input 'x' can't be read"),
    (with_tensor("outputs", channels=["albedo.rgb"]), "can't be written (expected one of: direct.diffuse.rgb"),
])
def test_a_wrong_contract_says_what_and_where(text: str, message: str) -> None:
    with pytest.raises(ModelError) as caught:
        contract_from_json(text, "here")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "expected" in caught.value.expected


def test_null_stands_for_an_absent_value() -> None:
    value = json.loads(with_tensor("inputs", size=None, rays=None))
    assert contract_from_json(json.dumps({**value, "cube_axes": None, "static_input": None}), "here") == TINY


def test_whole_numbers_may_be_written_with_a_point() -> None:
    text = changed(multiple_of=4.0)
    assert "4.0" in text and contract_from_json(text, "here") == TINY


def test_a_contract_is_valid_by_construction() -> None:
    with pytest.raises(ModelError, match=r"contract of 'x': scale: 2 is out of range"):
        ModelContract("x", TINY.inputs, TINY.outputs, scale=2, exposure="none", bounces="multi", scene_extent=40)


@pytest.mark.parametrize("content", [b"", b"solid nonsense", b"\x00" * 64, b"\xff" * 64, bytes(range(256)) * 4])
def test_an_unreadable_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.onnx"
    path.write_bytes(content)
    with pytest.raises(ModelError, match=r"broken\.onnx: not a readable ONNX file"):
        read_contract(path)


def test_a_truncated_file_is_refused(tmp_path: Path) -> None:
    path = write_tiny_network(tmp_path / "cut.onnx")
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(ModelError, match="not a readable ONNX file"):
        read_contract(path)


def test_a_missing_or_unreadable_path_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="can't read the network"):
        read_contract(tmp_path / "none.onnx")
    with pytest.raises(ModelError, match="can't read the network"):
        read_contract(tmp_path)


def test_a_file_without_contract_names_the_command_that_adds_it(tmp_path: Path) -> None:
    path = write_tiny_network(tmp_path / "bare.onnx", contract=None)
    with pytest.raises(ModelError, match=rf"python -m export onnx stamp {path} CONTRACT\.json"):
        read_contract(path)


def test_an_unknown_network_lists_the_known_ones() -> None:
    assert list(bundled_models()) == sorted(bundled_models())
    known = ", ".join(bundled_models())
    with pytest.raises(ModelError, match=rf"did you mean 'radiosity'\? expected one of: none, {known}, ssgi"):
        find_model("radiosty")
    with pytest.raises(ModelError, match=r"did you mean 'ssgi'\? expected one of: .*radiosity.*, ssgi"):
        find_model("sgi")


def test_the_classical_method_has_no_file() -> None:
    assert find_model("ssgi") == SSGI == "ssgi"
    assert SSGI not in bundled_models()
