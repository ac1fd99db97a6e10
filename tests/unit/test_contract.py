"""The contract: what is accepted, and what each mistake says."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from app.errors import ModelError
from app.network.contract import HALF, SSGI, ModelContract, bundled_models, find_model, read_contract
from tests.tiny_network import TINY, write_tiny_network


def changed(**changes: Any) -> str:
    return json.dumps({**json.loads(TINY.to_json()), **changes})


def with_tensor(group: str, **changes: Any) -> str:
    value = json.loads(TINY.to_json())
    next(iter(value[group].values())).update(changes)
    return json.dumps(value)


def without(key: str) -> str:
    return json.dumps({k: v for k, v in json.loads(TINY.to_json()).items() if k != key})


def test_json_and_back_is_the_same() -> None:
    assert ModelContract.from_json(TINY.to_json(), "here") == TINY


def test_bundled_networks_have_valid_contracts_and_cards() -> None:
    assert {"ember", "gather", "radiosity"} <= set(bundled_models())
    for name, path in bundled_models().items():
        contract = read_contract(path)
        assert contract.name == name and contract.licence
        assert path.with_name(f"{name.removesuffix(HALF)}.md").is_file()
        assert find_model(name) == path


def test_the_screen_grid_is_never_empty() -> None:
    contract = read_contract(find_model("radiosity"))
    assert contract.screen_size((1024, 768)) == (64, 48)
    assert contract.screen_size((256, 192)) == (64, 48)  # small images keep 48 texels
    assert contract.screen_size((1, 17)) == (1, 9)  # up to half of them


@pytest.mark.parametrize(("text", "message"), [
    ("{", "no JSON"),
    ("[]", "the contract is []"),
    (changed(version=2), "version 2, here, expected version 1"),
    (without("version"), "version None"),
    (changed(sclae=0.5), "unknown key 'sclae' in the contract, here, expected 'scale'?"),
    (without("scale"), "no key 'scale'"),
    (changed(scale=0), "bad scale 0"),
    (changed(scale=1.5), "bad scale 1.5"),
    (changed(scale="half"), "bad scale 'half'"),
    (changed(multiple_of=0), "bad multiple_of 0"),
    (changed(scene_extent=-1), "bad scene_extent"),
    (changed(dtype="int8"), "bad dtype 'int8', here, expected one of float32, float16"),
    (changed(exposure="auto"), "bad exposure 'auto', here, expected one of mean-radiance, none"),
    (changed(bounces=3), "bad bounces 3"),
    (changed(name=3), "bad name 3"),
    (changed(inputs={}), "no inputs or no outputs"),
    (changed(inputs=["x"]), "bad inputs"),
    (changed(inputs={"x": 3}), "tensor 'x' is 3"),
    (with_tensor("inputs", channels=["direct.rgb", "normal.world.xzy"]),
     "unknown channel 'normal.world.xzy' of tensor 'x', here, expected 'normal.world.xyz'?"),
    (with_tensor("inputs", channels="direct.rgb"), "bad channels"),
    (with_tensor("inputs", channels=[]), "no channels"),
    (with_tensor("inputs", grid="sphere"), "bad grid 'sphere'"),
    (with_tensor("inputs", size=8), "bad size 8"),
    (with_tensor("inputs", gird="cube"), "unknown key 'gird' in tensor 'x', here, expected 'grid'?"),
    (with_tensor("inputs", grid="cube"), "bad size None"),
    (with_tensor("inputs", grid="cube", size=8), "no cube_axes"),
    (with_tensor("inputs", grid="globals", size=8), "bad size 8"),
    (with_tensor("inputs", grid="globals"), "is not provided on the globals grid"),
    (with_tensor("inputs", grid="panorama", size=18), "a panorama 18 high"),
    (with_tensor("inputs", grid="panorama", size=16), "no cube_axes"),
    (changed(cube_axes="world", inputs={
        "x": {"channels": ["depth"]}, "c": {"channels": ["depth"], "grid": "cube", "size": 16},
        "p": {"channels": ["depth"], "grid": "panorama", "size": 16}}), "different faces [8, 16]"),
    (with_tensor("inputs", channels=["on_screen"]), "channel 'on_screen' is not provided on the screen grid"),
    (with_tensor("outputs", channels=["albedo.rgb"]), "can't be written, here, expected one of direct.diffuse.rgb"),
])
def test_a_wrong_contract_says_what_and_where(text: str, message: str) -> None:
    with pytest.raises(ModelError) as caught:
        ModelContract.from_json(text, "here")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "expected" in caught.value.expected


def test_a_contract_is_valid_by_construction() -> None:
    with pytest.raises(ModelError, match="bad scale"):
        ModelContract("x", TINY.inputs, TINY.outputs, scale=2, exposure="none", bounces="multi", scene_extent=40)


@pytest.mark.parametrize("content", [b"", b"solid nonsense", b"\x00" * 64, b"\xff" * 64, bytes(range(256)) * 4])
def test_an_unreadable_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.onnx"
    path.write_bytes(content)
    with pytest.raises(ModelError, match=r"not a readable ONNX file.*broken\.onnx"):
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
    with pytest.raises(ModelError, match=rf"python -m export stamp {path} CONTRACT\.json"):
        read_contract(path)


def test_an_unknown_network_lists_the_known_ones() -> None:
    assert list(bundled_models()) == sorted(bundled_models())
    known = ", ".join(bundled_models())
    with pytest.raises(ModelError, match=rf"no network 'radiosty'.*'radiosity'\? Known: one of {known}, ssgi"):
        find_model("radiosty")
    with pytest.raises(ModelError, match=r"'ssgi'\? Known: one of .*radiosity.*, ssgi"):
        find_model("sgi")


def test_the_classical_method_has_no_file() -> None:
    assert find_model("ssgi") == SSGI == "ssgi"
    assert SSGI not in bundled_models()
