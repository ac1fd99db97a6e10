"""Commands of ``python -m export`` that draw or write files for developers."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

if any(importlib.util.find_spec(name) is None for name in ("mitsuba", "torch", "distributed")):
    pytest.skip("the extra 'export' is not installed", allow_module_level=True)

from app.errors import AfterglowError
from app.golden.catalogue import PROBE, PROBE_ENVIRONMENT
from app.io.image import read_exr
from app.network.contract_json import read_contract
from export.__main__ import cli
from export.dataset import contact_sheet
from export.dataset.scene_key import scene_key
from export.onnx import probe
from export.validation import choose_views
from export.validation.views import generated

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("egl")]

TOML = ("size = [64, 48]\nspp = 4\nmax_bounces = 4\ndenoise = false\n[sources]\n"
        "room = {weight = 1, pairs_per_scene = 2}\n")


def run(*arguments: str) -> str:
    done = CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


@pytest.fixture
def few_views(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The list that ``validate choose`` writes, of two views."""
    for name, value in {"FILES": {}, "GENERATED": (("room", 0),), "VIEWS_OF_GENERATED": 2, "CANDIDATES": 8,
                        "TRAINING_FILES": {}, "EMISSIVE_GENERATED": (),
                        "LIST": tmp_path / "views.json"}.items():
        monkeypatch.setattr(choose_views, name, value)
    return tmp_path / "views.json"


@pytest.mark.usefixtures("path_tracer")
def test_choose_writes_the_list_without_dropped_views(tmp_path: Path, few_views: Path) -> None:
    run("validate", "choose", "--drop", "room-0-1", "--sheet", str(tmp_path / "sheet.png"))
    listed = json.loads(few_views.read_text("utf-8"))
    assert [view["name"] for view in listed["views"]] == ["room-0-0"] and listed["dropped"] == ["room-0-1"]
    assert listed["views"][0]["key"] == scene_key(generated("room", 0).scene)
    width, height = Image.open(tmp_path / "sheet.png").size
    assert (width, height) == (contact_sheet.COLUMNS * listed["size"][0], listed["size"][1])


@pytest.mark.usefixtures("path_tracer")
def test_a_reference_of_the_automatic_camera(tmp_path: Path) -> None:
    run("reference", "--camera", "auto", "--size", "8x6", "--spp", "1", "--out", str(tmp_path))
    assert json.loads((tmp_path / "reference.json").read_text("utf-8"))["camera"] == "auto"
    assert (tmp_path / "reference.exr").is_file()


def test_probe_writes_the_networks_of_the_goldens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(probe, "PROBE", tmp_path / "probe.onnx")
    monkeypatch.setattr(probe, "PROBE_ENVIRONMENT", tmp_path / "probe_environment.onnx")
    assert len(run("onnx", "probe").splitlines()) == 2
    for bundled in (PROBE, PROBE_ENVIRONMENT):
        assert read_contract(tmp_path / bundled.name) == read_contract(bundled)


@pytest.mark.usefixtures("path_tracer")
def test_sheet_shows_the_first_pairs_of_a_dataset(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(TOML)
    data, picture = tmp_path / "data", tmp_path / "sheet.jpg"
    run("dataset", "make", "--out", str(data), "--frames", "2", "--config", str(tmp_path / "small.toml"),
        "--workers", "1")
    run("dataset", "sheet", str(data), str(picture), "--count", "2")
    sheet = Image.open(picture)
    assert sheet.size == (8 * 160, 120)
    shown = [sheet.crop((160 * k, 0, 160 * k + 160, 120)).convert("L").getextrema()[1] for k in range(3)]
    assert min(shown[:2]) > 50 and shown[2] < 10


@pytest.mark.parametrize(("arguments", "message"), [
    (["onnx", "precision", "nope"], r"NETWORK: no untrained network 'nope' \(.*expected one of: [^()]+[^t]\)$"),
    (["onnx", "write", "nope"], r"NETWORK: no untrained network 'nope' \(.*, or a checkpoint \(\.pt\)\)$"),
    (["onnx", "linearity", "nope"], "NETWORK: no model 'nope'"),
    (["onnx", "linearity", "ssgi"], "NETWORK: 'ssgi' is not a network"),
    (["onnx", "write", "gather", "--out", "FOLDER/file/out"], "file/out: is not a writable folder"),
    (["onnx", "scaling", "--out", "FOLDER/file/out"], "file/out: is not a writable folder"),
    (["onnx", "stamp", "FOLDER/a.onnx", "FOLDER/file"], r"file: can't read the contract \(not UTF-8\)"),
    (["reference", "--scene-json", "bad.json"], r"--scene-json: needs a scene \(expected a SCENE too\)"),
    (["reference", "--studio"], r"--studio: needs a scene \(expected a SCENE too\)"),
    (["reference", "--ground"], r"--ground: needs a scene \(expected a SCENE too\)"),
    (["reference", "--camera", "nope"], r"--camera: unknown name 'nope' \(expected one of: auto, "),
    (["reference", "--size", "0x4"], "--size: bad size 0x4"),
    (["reference", "--baselines", "0"], "--baselines: bad samples per pixel '0'"),
    (["reference", "--denoise", "--baselines", "1,2"], "--denoise: baselines are not denoised")])
def test_a_wrong_argument_is_one_error(arguments: list[str], message: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"\xff")
    with pytest.raises(AfterglowError, match=message):
        run(*(argument.replace("FOLDER", str(tmp_path)) for argument in arguments))


@pytest.mark.usefixtures("path_tracer")
def test_a_reference_can_be_denoised(tmp_path: Path) -> None:
    options = "--size", "32x24", "--spp", "4", "--max-bounces", "2"
    raw, clean = (run("reference", *options, *more, "--out", str(tmp_path / name))
                  for name, more in (("raw", ()), ("clean", ("--denoise",))))
    assert raw.startswith("the path tracer is compiled for the scene first")
    assert "denoised" not in raw and clean.count("before it was denoised") == 3  # of all but direct light
    for name, denoised in (("raw", False), ("clean", True)):
        assert json.loads((tmp_path / name / "reference.json").read_text())["denoised"] is denoised
    noisy, smooth = (np.abs(np.diff(read_exr(tmp_path / name / "reference.exr")[""], axis=1)).mean()
                     for name in ("raw", "clean"))
    assert smooth < 0.7 * noisy


@pytest.mark.usefixtures("path_tracer")
@pytest.mark.parametrize(("arguments", "message"), [
    (["--drop", "room-0-2"], r"--drop: no view 'room-0-2' \(did you mean 'room-0-\d'\? expected one of: room-0-0, "),
    (["--sheet", "FOLDER/sheet.unknown"], "unknown suffix '.unknown'"),
    (["--sheet", "FOLDER/views.json/sheet.png"], "is not a writable folder"),
    (["--sheet", "FOLDER/folder.png"], "can't write the file")])
def test_choose_keeps_the_list_if_an_option_is_wrong(
        arguments: list[str], message: str, tmp_path: Path, few_views: Path) -> None:
    few_views.write_text("old")
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(AfterglowError, match=message):
        run("validate", "choose", *(argument.replace("FOLDER", str(tmp_path)) for argument in arguments))
    assert few_views.read_text() == "old"
