"""A user's own scenes and models: a JSON file, and goldens of their own."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import onnx
import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.errors import AfterglowError
from app.golden import SceneCase, Shot, check, read_catalogue, update
from app.golden.network_case import NetworkCase
from app.network.contract import KEY
from app.network.contract_json import contract_to_json
from tests.tiny_network import TINY, write_tiny_network

BOX = """v -1 0 -1
v 1 0 -1
v 1 0 1
v -1 0 1
f 1 4 3 2
"""
SIDECAR = {
    "cameras": {"near": {"eye": [0, 1, 2], "target": [0, 0, 0]}, "far": {"eye": [0, 3, 4], "target": [0, 0, 0]}},
    "lightings": {"lamp": {"lights": [{"type": "point", "position": [0, 1, 0], "intensity": [1, 1, 1]}]},
                  "dark": {"lights": []}},
}
HALL: dict[str, Any] = {
    "scene": "floor.obj", "lighting": "lamp", "model": "tiny.onnx", "size": [32, 24],
    "shots": [{"camera": "near", "frames": 2}, {"camera": "far", "frames": 1}], "kept": [1, 3],
}


@pytest.fixture
def catalogue(tmp_path: Path) -> Path:
    (tmp_path / "floor.obj").write_text(BOX)
    (tmp_path / "floor.json").write_text(json.dumps(SIDECAR))
    write_tiny_network(tmp_path / "tiny.onnx")
    path = tmp_path / "mine.json"
    path.write_text(json.dumps({"cases": {"hall": HALL, "plain": {"scene": "floor.obj"}}}))
    return path


def test_cases_are_what_the_file_says(catalogue: Path) -> None:
    cases = read_catalogue(catalogue)
    assert list(cases) == ["hall", "hall.network", "plain"]
    hall, network, plain = cases.values()
    assert isinstance(hall, SceneCase)
    assert isinstance(network, NetworkCase)
    assert isinstance(plain, SceneCase)
    assert (hall.size, hall.golden_frames, hall.taa, hall.scene.lighting) == ((32, 24), (1, 3), True, "lamp")
    assert hall.shots == (Shot("near", 2), Shot("far", 1))
    assert network.model == catalogue.parent / "tiny.onnx"
    assert (plain.size, plain.golden_frames, plain.shots, plain.model) == ((256, 192), (3,), (Shot("near", 3),), None)


@pytest.mark.gl
@pytest.mark.usefixtures("coarse_shadows")
def test_update_then_check(catalogue: Path) -> None:
    folder, page = catalogue.parent / "goldens", catalogue.parent / "page.html"
    options = ["--catalogue", str(catalogue), "--golden", str(folder)]
    run = CliRunner()
    assert run.invoke(cli, ["golden", "check", *options, "--report", str(page)]).exit_code == 1
    assert run.invoke(cli, ["golden", "update", *options]).exit_code == 0
    assert sorted(f.name for f in folder.iterdir()) == ["hall", "hall.network", "plain"]
    assert run.invoke(cli, ["golden", "check", *options]).exit_code == 0
    catalogue.write_text(json.dumps({"cases": {"hall": HALL | {"lighting": "dark"}}}))
    result = run.invoke(cli, ["golden", "check", *options, "--report", str(page)])
    assert result.exit_code == 1
    assert "first broken stage of hall: " in result.stdout
    assert "first broken stage of plain: – (plain, orphan)" in result.stdout


@pytest.mark.parametrize(("change", "message"), [
    ({"modell": "none"}, "{file}: cases.hall.modell: unknown key 'modell' (did you mean 'model'?"),
    ({"scene": 3}, "{file}: cases.hall.scene: wrong kind of value 3 (expected a string"),
    ({"size": [32]}, "{file}: cases.hall.size: 1 values (expected at least 2"),
    ({"size": [0, 24]}, "{file}: cases.hall.size[0]: 0 is out of range (expected at least 1"),
    ({"size": [31.5, 24]}, "{file}: cases.hall.size[0]: wrong kind of value 31.5 (expected a whole number"),
    ({"kept": [4]}, "{file}: cases.hall.kept: no frame 4 (expected frames from 1 to 3"),
    ({"shots": [{"camera": "fra"}]}, "{file}: cases.hall.shots[0].camera: no camera 'fra' (did you mean 'far'?"),
    ({"shots": []}, "{file}: cases.hall.shots: 0 values (expected at least 1"),
    ({"model": "gathr"}, "{file}: cases.hall.model: no model 'gathr' (did you mean 'gather'?"),
    ({"lighting": "lmap"}, "'lmap'"),
    ({"scene_json": "a\0b.json"}, "can't read the JSON file"),
    ({"scene": "none.obj"}, "no such scene file"),
])
def test_mistakes_name_their_key(catalogue: Path, change: dict[str, Any], message: str) -> None:
    catalogue.write_text(json.dumps({"cases": {"hall": HALL | change}}))
    with pytest.raises(AfterglowError) as caught:
        read_catalogue(catalogue)
    assert message.format(file=catalogue) in str(caught.value)


@pytest.mark.gl
@pytest.mark.parametrize("tensor", ["in/x:0", "../../x"])
def test_a_tensor_of_any_name_gets_a_file_of_its_own(catalogue: Path, tensor: str) -> None:
    network = onnx.load(catalogue.parent / "tiny.onnx")
    network.graph.input[0].name = network.graph.node[0].input[0] = tensor
    onnx.helper.set_model_props(network, {KEY: contract_to_json(replace(TINY, inputs={tensor: TINY.inputs["x"]}))})
    onnx.save(network, catalogue.parent / "tiny.onnx")
    cases, folder = read_catalogue(catalogue), catalogue.parent / "goldens"
    chosen = [cases["hall"], cases["hall.network"]]
    update(chosen, folder, cases)
    assert {f.verdict for f in check(chosen, folder).findings} == {"same"}
    assert all(file.parent.parent == folder for file in folder.rglob("*.exr"))


@pytest.mark.parametrize(("content", "said"), [
    ({}, "missing key 'cases'"), ({"cases": {}}, "expected at least 1"),
    ({"cases": {"../x": HALL}}, "invalid name '../x'"), ({"cases": {"hall": {}}}, "missing key 'scene'"),
])
def test_a_catalogue_needs_cases_with_names_and_scenes(catalogue: Path, content: object, said: str) -> None:
    catalogue.write_text(json.dumps(content))
    with pytest.raises(AfterglowError) as caught:
        read_catalogue(catalogue)
    assert said in str(caught.value)
