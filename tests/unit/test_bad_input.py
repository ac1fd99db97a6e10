"""Every mistake that a user can make on the command line: one line, exit code 2, nothing left behind."""

from __future__ import annotations

import contextlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.gl.context import Device
from app.network.contract_json import contract_to_json
from tests.tiny_network import TINY, write_tiny_network

ROOT = Path(__file__).parents[2]
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n"
LAMP = {"type": "point", "position": [0, 0, 2], "intensity": [1, 1, 1]}
SCENE_JSON = {"lightings": {"sun": {"lights": [LAMP]}}}
CONTRACT = json.loads(contract_to_json(TINY))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with valid and broken files, in which the command line runs."""
    monkeypatch.chdir(tmp_path)
    Path("good.obj").write_text(TRIANGLE + "f 1 2 3\n")
    Path("empty.obj").write_text(TRIANGLE)
    Path("flat.obj").write_text("v 0 0 0\nf 1 1 1\n")
    Path("textured.obj").write_text("mtllib textured.mtl\n" + TRIANGLE + "usemtl m\nf 1/1 2/1 3/1\n")
    Path("textured.mtl").write_text("newmtl m\nmap_Kd broken.png\n")
    Path("broken.png").write_bytes(b"\x89PNG\r\n\x1a\nnot really")
    Path("broken.glb").write_bytes(b"glTF\x02\x00\x00\x00")
    Path("scene.xyz").write_text("")
    Path("notes.txt").write_text("mine")
    Path("folder").mkdir()
    Path("camera.json").write_text(json.dumps({"eye": [0, 0, 3], "target": [0, 0, 0], "fov": 45}))
    Path("good.json").write_text(json.dumps(SCENE_JSON))
    Path("misspelt.json").write_text(json.dumps({"lightngs": SCENE_JSON["lightings"]}))
    Path("half.json").write_text("{")
    Path("garbage.onnx").write_bytes(b"\x00\x01garbage" * 99)
    write_tiny_network(Path("bare.onnx"), None)
    write_tiny_network(Path("wide.onnx"), channels=9)
    unknown = {**CONTRACT, "inputs": {"x": {"channels": ["direct.rbg", "normal.world.xyz"], "grid": "screen"}}}
    write_tiny_network(Path("unknown.onnx"), json.dumps(unknown))
    write_tiny_network(Path("misspelt.onnx"), json.dumps({**CONTRACT, "scael": 1}))
    write_tiny_network(Path("future.onnx"), json.dumps({**CONTRACT, "version": 3}))
    write_tiny_network(Path("good.onnx"))
    return tmp_path


def refused(args: list[str], folder: Path) -> str:
    """The line on stderr of a run that must fail and leave nothing behind."""
    before = sorted(folder.rglob("*"))
    result = CliRunner().invoke(cli, args)
    assert result.exit_code == 2, result.output
    assert isinstance(result.exception, SystemExit)
    lines = [line for line in result.stderr.splitlines() if not line.startswith("note:")]
    assert len(lines) == 1, result.stderr
    assert re.fullmatch(r"error: .+: .+ \(.+\)", lines[0]), lines[0]
    assert result.stdout == ""
    assert sorted(folder.rglob("*")) == before
    return lines[0]


@pytest.mark.parametrize(("args", "said"), [
    (["gone.obj"], ["gone.obj", "no such"]),
    (["folder"], ["folder"]),
    (["scene.xyz"], ["scene.xyz", ".obj"]),
    (["empty.obj"], ["empty.obj", "triangle"]),
    (["flat.obj"], ["flat.obj", "triangle"]),
    (["broken.glb"], ["broken.glb"]),
    (["textured.obj"], ["broken.png"]),
    (["good.obj", "--scene-json", "gone.json"], ["gone.json"]),
    (["good.obj", "--scene-json", "half.json"], ["half.json", "JSON"]),
    (["good.obj", "--scene-json", "misspelt.json"], ["misspelt.json", "lightngs", "lightings"]),
    (["good.obj", "--lighting", "sum"], ["sum", "sun"]),
    (["--lighting", "lmap"], ["lmap", "lamp"]),
    (["good.obj", "--variant", "red"], ["red", "good.obj"]),
    (["--variant", "red"], ["--variant", "SCENE"]),
    (["--settle", "-3"], ["--settle", "expected a value greater than or equal to 0"]),
    (["--frames", "x"], ["--frames", "expected a valid integer"]),
    (["good.obj", "--camera", "orbti"], ["--camera", "orbit"]),
    (["good.obj", "--camera", "gone.json"], ["gone.json"]),
    (["good.obj", "--camera", "camera.json"], ["camera.json", "fov"]),
    (["--aov", "final,norml"], ["--aov", "normal"]),
    (["--format", "exr,jpg"], ["--format", "png"]),
    (["--size", "0x10"], ["--size", "0x10"]),
    (["--size", "10x0"], ["--size"]),
    (["--size", "-1x10"], ["--size"]),
    (["--size", "16385x8"], ["--size", "16384"]),
    (["--frames", "0"], ["--frames"]),
    (["--settle", "-1"], ["--settle"]),
    (["--exposure", "0"], ["--exposure"]),
    (["--exposure", "inf"], ["--exposure"]),
    (["--seed", "-3"], ["--seed"]),
    (["--model", "gathr"], ["--model", "gather"]),
    (["--model", "gone.onnx"], ["gone.onnx"]),
    (["--model", "folder"], ["folder"]),
    (["--no-such"], ["--no-such"]),
])
def test_refused_before_opening_a_device(folder: Path, args: list[str], said: list[str]) -> None:
    line = refused(args if "--model" in args else [*args, "--model", "none"], folder)
    assert all(word in line for word in said), line


@pytest.mark.gl
@pytest.mark.parametrize(("args", "said"), [
    (["--model", "garbage.onnx"], ["garbage.onnx", "ONNX"]),
    (["--model", "notes.txt"], ["notes.txt", "ONNX"]),
    (["--model", "bare.onnx"], ["bare.onnx", "python -m export onnx stamp"]),
    (["--model", "wide.onnx"], ["wide.onnx", "[1, 9,", "[1, 6,"]),
    (["--model", "unknown.onnx"], ["unknown.onnx", "direct.rbg", "direct.rgb"]),
    (["--model", "misspelt.onnx"], ["misspelt.onnx", "scael", "scale"]),
    (["--model", "future.onnx"], ["future.onnx", "version"]),
    (["--model", "good.onnx", "--provider", "cdua"], ["--provider", "cpu"]),
    (["--model", "none", "--provider", "cdua"], ["--provider", "cpu"]),
    (["--out", "notes.txt"], ["notes.txt"]),
    (["--out", "notes.txt/deep"], ["notes.txt"]),
    (["--out", "/proc/nowhere"], ["/proc/nowhere"]),
    (["--timing", "notes.txt/timing.json"], ["notes.txt"]),
    (["--timing", "folder"], ["folder"]),
    (["--out", ""], ["--out"]),
])
def test_refused_before_the_first_frame(folder: Path, args: list[str], said: list[str]) -> None:
    line = refused(["good.obj", "--size", "8x8", *args], folder)
    assert all(word in line for word in said), line


@pytest.mark.gl
def test_a_size_that_does_not_fit_into_memory(folder: Path) -> None:
    line = refused(["good.obj", "--size", "16384x16384", "--model", "none", "--aov", "position"], folder)
    assert "16384x16384" in line
    assert "smaller size" in line


@pytest.mark.gl
def test_more_lights_than_fit_into_the_uniform_block(folder: Path) -> None:
    with contextlib.closing(Device()) as device:
        max_lights = device.ctx.info["GL_MAX_UNIFORM_BLOCK_SIZE"] // 128
    if max_lights > 10_000:
        pytest.skip(f"this GL has room for {max_lights} lights")
    Path("crowd.json").write_text(json.dumps({"lightings": {"all": {"lights": [LAMP] * (max_lights + 1)}}}))
    line = refused(["good.obj", "--scene-json", "crowd.json", "--size", "8x8", "--model", "none"], folder)
    assert all(word in line for word in (f"{max_lights + 1} lights", "good", f"at most {max_lights}")), line


@pytest.mark.gl
@pytest.mark.parametrize("broken", ["no vendor", "no library"])
def test_without_egl_the_line_names_the_packages(folder: Path, broken: str) -> None:
    variables = {"__EGL_VENDOR_LIBRARY_FILENAMES": str(folder / "gone.json")}
    if broken == "no library":
        (folder / "folder" / "libEGL.so.1").touch()
        (folder / "folder" / "libEGL.so").touch()
        variables = {"LD_LIBRARY_PATH": str(folder / "folder")}
    run = subprocess.run([sys.executable, "-m", "app", "good.obj", "--size", "8x8", "--model", "none"], cwd=folder,
                         env={**os.environ, "PYTHONPATH": str(ROOT), **variables}, capture_output=True, text=True,
                         check=False)
    assert run.returncode == 2
    errors = [line for line in run.stderr.splitlines() if not line.startswith("note:")]
    assert len(errors) == 1
    assert "libegl1 and libgl1-mesa-dri" in errors[0]
    assert not (folder / "out").exists()


@pytest.mark.gl
def test_good_input_is_written_whole(folder: Path) -> None:
    result = CliRunner().invoke(cli, ["good.obj", "--size", "8x8", "--model", "good.onnx", "--timing", "t/t.json"])
    assert result.exit_code == 0, result.output
    assert sorted(p.name for p in (folder / "out").iterdir()) == ["0000.exr", "0000.png"]
    assert json.loads((folder / "t" / "t.json").read_text())["frames"] == 1
