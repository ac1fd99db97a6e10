"""The command line, with a renderer that draws nothing."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.cli.options import parse_names
from app.cli.render import choose_camera
from app.errors import DeviceError, ProcessError, SettingsError
from app.graph import BoundPass, Pass, Plan, Tex
from app.io.aov_preview import preview
from app.io.child_process import run_module
from app.io.image import read_exr, read_png
from app.load import embedded_scene
from app.scene import Camera
from app.settings import Settings, parse_size

ROOT = Path(__file__).parents[2]
AOVS = {"final": "what the camera sees", "normal": "world space", "depth": "linear", "motion": "pixels"}
COMPONENTS = {"final": 3, "normal": 3, "depth": 1, "motion": 2}


class FakeRenderer:
    """Claims to run every pass, and fills images with the frame's number."""

    made: list[FakeRenderer]

    def __init__(self, scene: object, settings: Settings, model: Path | None) -> None:
        self.scene, self.settings, self.model = scene, settings, model
        self.missing = ("motion",) if "motion" in settings.outputs else ()
        self.calls: list[tuple[str, Camera, float]] = []
        self.device = {"gl_renderer": "fake GL", "gl_version": "4.5", "provider": "FakeProvider", "rays": "cpu"}
        self.shadow_methods = {"RectLight by rays": 2, "SpotLight by shadow map": 1}
        names = ("gbuffer", "direct", *(["taa"] if settings.taa else []))
        self.plan = Plan(tuple(BoundPass(Pass(n), (), ()) for n in names), {"cube_gbuffer": "no network asks for it"},
                         frozenset(), {n: Tex("f2", 4) for n in names})
        self.made.append(self)

    def __enter__(self) -> FakeRenderer:
        return self

    def __exit__(self, *_: object) -> None: ...

    def advance(self, camera: Camera, time: float = 0.0) -> None:
        self.calls.append(("advance", camera, time))

    def render(self, camera: Camera, time: float = 0.0, following: object = None,
               names: tuple[str, ...] = ()) -> dict[str, np.ndarray]:
        number = sum(kind == "render" for kind, *_ in self.calls)
        self.calls.append(("render", camera, time))
        width, height = self.settings.size
        images = {n: np.full((height, width, COMPONENTS[n]), number, np.float32) for n in self.settings.outputs}
        if "final" in images:
            images["display"] = np.full((height, width, 3), number, np.uint8)
        return {name: images[name] for name in names or images}

    def timing(self) -> dict[str, object]:
        clocks = {"cpu_ms": {"median": 1.5, "p95": 2.0}, "gpu_ms": {"median": 0.25, "p95": 0.5}}
        passes = {p.name: {**clocks, "non_finite": 0} for p in self.plan.passes}
        return {"frame": {"cpu_ms": clocks["cpu_ms"], "gpu_ms": {}}, "passes": {**passes, "copy": clocks}}


@pytest.fixture
def invoke(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., object]:
    """Run the command line in an empty folder."""
    FakeRenderer.made = []
    monkeypatch.setitem(sys.modules, "app.renderer", types.SimpleNamespace(Renderer=FakeRenderer))
    monkeypatch.setitem(sys.modules, "app.frame", types.SimpleNamespace(AOVS=AOVS))
    monkeypatch.chdir(tmp_path)
    return lambda *args: CliRunner().invoke(cli, [*args, *([] if "--model" in args else ["--model", "none"])])


def failed(result: object) -> str:
    """The one line of a user's error."""
    assert result.exit_code == 2, result.output
    assert isinstance(result.exception, SystemExit)
    lines = [line for line in result.stderr.splitlines() if not line.startswith("note:")]
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    assert re.fullmatch(r"error: .+: .+ \(.+\)", lines[0]), lines[0]
    return lines[0]


@pytest.mark.parametrize("args", [["--size", "8x6"], ["render", "--size", "8x6"]])
def test_a_still_settles_and_is_written(invoke, tmp_path: Path, args: list[str]) -> None:
    result = invoke(*args)
    assert result.exit_code == 0, result.output
    kinds = [kind for kind, *_ in FakeRenderer.made[0].calls]
    assert kinds == ["advance"] * 16 + ["render"]
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["0000.exr", "0000.png"]
    assert read_exr(tmp_path / "out" / "0000.exr").keys() == {""}
    assert read_png(tmp_path / "out" / "0000.png").shape == (6, 8, 3)
    assert not FakeRenderer.made[0].settings.timing
    assert "gbuffer" not in result.stdout
    assert "1.50 ms per frame" in result.stdout


def test_passes_are_timed_only_on_request(invoke) -> None:
    result = invoke("--size", "8x6", "--timing", "timing.json")
    assert FakeRenderer.made[0].settings.timing
    assert re.search("gbuffer.*1.50.*0.25", result.stdout)
    result = invoke("--size", "8x6", "--check")
    assert not FakeRenderer.made[1].settings.timing
    assert re.search("gbuffer.* 0 ", result.stdout) and "1.50" not in result.stdout


def test_no_settling_without_taa_or_with_several_frames(invoke) -> None:
    for args in (["--no-taa"], ["--frames", "3"], ["--settle", "0"]):
        assert invoke("--size", "2x2", *args).exit_code == 0
        assert {kind for kind, *_ in FakeRenderer.made[-1].calls} == {"render"}


def test_frames_advance_by_a_thirtieth_and_settling_stays_at_the_first(invoke, tmp_path: Path) -> None:
    result = invoke("--size", "2x2", "--frames", "3", "--settle", "2", "--camera", "orbit", "--format", "exr")
    assert result.exit_code == 0, result.output
    calls = FakeRenderer.made[0].calls
    assert [time for *_, time in calls] == [0, 0, 0, 1 / 30, 2 / 30]
    assert calls[0][1] == calls[2][1] != calls[3][1]
    for index in range(3):
        assert read_exr(tmp_path / "out" / f"{index:04d}.exr")[""].max() == index


def test_a_video_holds_all_frames_and_is_one_file(invoke, tmp_path: Path) -> None:
    result = invoke("--size", "16x12", "--frames", "3", "--format", "mp4,png")
    assert result.exit_code == 0, result.output
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["0000.png", "0001.png", "0002.png", "video.mp4"]
    with av.open(str(tmp_path / "out" / "video.mp4")) as container:
        assert len(list(container.decode(video=0))) == 3


def test_aovs_are_layers_and_the_first_one_is_the_picture(invoke, tmp_path: Path) -> None:
    result = invoke("--size", "4x2", "--aov", "normal,depth,motion")
    assert result.exit_code == 0, result.output
    assert "note: motion is all zero" in result.stderr
    layers = read_exr(tmp_path / "out" / "0000.exr")
    assert {name: a.shape for name, a in layers.items()} == {
        "normal": (2, 4, 3), "depth": (2, 4, 1), "motion": (2, 4, 2)}
    assert read_png(tmp_path / "out" / "0000.png").max() == 128


@pytest.mark.parametrize(("formats", "read"), [("png", ("display",)), ("png,exr", ()), ("exr", ())])
def test_final_is_read_only_for_exr(invoke, monkeypatch: pytest.MonkeyPatch, formats: str, read: object) -> None:
    names = []
    render = FakeRenderer.render
    monkeypatch.setattr(FakeRenderer, "render", lambda *args: names.append(args[-1]) or render(*args))
    assert invoke("--size", "8x6", "--format", formats).exit_code == 0
    assert names == [read]


def test_options_reach_the_settings(invoke) -> None:
    assert invoke("--size", "4x2", "--no-taa", "--exposure", "2", "--bounces", "3", "--seed", "5",
                  "--provider", "cpu", "--strict-device", "--check").exit_code == 0
    assert FakeRenderer.made[0].settings == Settings(
        size=(4, 2), taa=False, exposure=2.0, bounces=3, seed=5, provider="cpu", strict_device=True, check=True)
    assert FakeRenderer.made[0].model == []


def test_timing_file(invoke, tmp_path: Path) -> None:
    assert invoke("--size", "4x2", "--frames", "2", "--timing", "deep/timing.json").exit_code == 0
    report = json.loads((tmp_path / "deep" / "timing.json").read_text())
    assert report.keys() == {"frame", "passes", "culled", "device", "model", "size", "scene", "triangles", "frames"}
    assert report["device"].keys() == {"gl_renderer", "gl_version", "provider", "rays"}
    assert report["culled"] == {"cube_gbuffer": "no network asks for it"}
    assert (report["size"], report["frames"], report["model"]) == ([4, 2], 2, None)


def test_verbose_lists_what_runs(invoke) -> None:
    text = invoke("--size", "2x2", "-v").stderr
    for said in ("fake GL", "FakeProvider", "rays: cpu", "gbuffer, direct, taa",
                 "cube_gbuffer: no network asks for it"):
        assert said in text


@pytest.mark.parametrize(("args", "said"), [
    (["--size", "0x4"], "--size"),
    (["--size", "4"], "--size"),
    (["--size", "99999x4"], "--size"),
    (["--aov", "normals"], "did you mean 'normal'"),
    (["--aov", ","], "--aov"),
    (["--format", "jpg"], "--format"),
    (["--format", "mp4", "--size", "15x12"], "divisible by 2"),
    (["--scale", "2"], "--scale"),
    (["--scale", "1/8"], "--scale: needs a network"),
    (["--frames", "0"], "--frames"),
    (["--frames", "many"], "--frames"),
    (["--exposure", "nan"], "--exposure"),
    (["--seed", "-1"], "--seed"),
    (["--bounces", "0"], "expected 1 to 64"),
    (["--bounces", "65"], "expected 1 to 64"),
    (["--bounces", "two"], "--bounces"),
    (["--fram", "3"], "--fram"),
    (["--camera", "nobody"], "--camera"),
    (["--camera", "missing.json"], "missing.json"),
    (["--model", "missing.onnx"], "--model: no such file 'missing.onnx'"),
    (["--model", "."], "--model: '.' is a folder"),
    (["missing.obj"], "missing.obj"),
    (["one.obj", "two.obj"], "two.obj"),
    (["rendr", "one.obj"], "no command or scene file 'rendr' (did you mean 'render'?"),
    (["a" * 300 + ".obj"], "File name too long"),
    (["--out", "o\udcff"], "--out: can't write to 'o\\udcff' (expected a name in UTF-8)"),
    (["--timing", "a" * 300 + ".json"], "File name too long"),
    (["missing.obj", "--model", "embr"], "did you mean 'ember'?"),
    (["--scene-json", "alone.json"], "--scene-json"),
])
def test_user_errors_are_one_line(invoke, tmp_path: Path, args: list[str], said: str) -> None:
    assert said in failed(invoke(*args))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("args", "said"), [
    (["--out", "taken"], "taken: is not a writable folder"),
    (["--timing", "taken/t.json"], "taken: is not a writable folder"),
    (["--tonemap", "agxx"], "did you mean 'agx'?"),
])
def test_what_cannot_be_written_is_found_before_loading(invoke, tmp_path: Path, args: list[str], said: str) -> None:
    (tmp_path / "taken").touch()
    assert said in failed(invoke("missing.obj", *args))
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_a_camera_of_the_scene_comes_before_the_words_of_the_option(invoke, tmp_path: Path) -> None:
    cameras = {name: {"eye": [x, 1, 3], "target": [0, 1, 0], "fov_y_deg": 40}
               for x, name in enumerate(("auto", "orbit", "a.json"))}
    (tmp_path / "cameras.json").write_text(json.dumps({"cameras": cameras}))
    scene = str(ROOT / "app" / "data" / "cornell-box.obj")
    for x, name in enumerate(cameras):
        assert invoke(scene, "--size", "2x2", "--scene-json", "cameras.json", "--camera", name).exit_code == 0
        assert FakeRenderer.made[-1].calls[-1][1].eye == (x, 1, 3)


def test_the_viewer_has_no_orbit() -> None:
    with pytest.raises(SettingsError, match=r"--camera: unknown name 'orbit' \(expected one of: auto, main\)"):
        choose_camera(embedded_scene(), "orbit")


def test_errors_of_several_lines_become_one(invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise DeviceError("no EGL\n  at all", "libEGL.so.1", "expected the package libegl1")

    monkeypatch.setattr(FakeRenderer, "__init__", broken)
    assert failed(invoke()) == "error: libEGL.so.1: no EGL at all (expected the package libegl1)"


def test_models_lists_contracts() -> None:
    table = CliRunner().invoke(cli, ["models"])
    listed = json.loads(CliRunner().invoke(cli, ["models", "--json"]).stdout)
    assert table.exit_code == 0
    assert all(name in table.stdout for name in listed)
    assert "radiosity" in listed
    assert listed["radiosity"]["contract"]["bounces"] == "multi"
    assert listed["ssgi"]["bounces"] == "single"


def test_help_names_every_option() -> None:
    text = CliRunner().invoke(cli, ["render", "--help"], env={"COLUMNS": "200"}).stdout
    for option in ("out", "size", "frames", "settle", "camera", "lighting", "scene-json", "model", "bounces", "aov",
                   "format", "exposure", "taa", "no-taa", "seed", "provider", "strict-device", "timing", "check",
                   "verbose"):
        assert f"--{option}" in text
    assert "python -m app models" in CliRunner().invoke(cli, ["--help"], env={"COLUMNS": "200"}).stdout


def test_parsing() -> None:
    assert parse_size("1024x768") == (1024, 768)
    assert parse_names("png, exr,png", ("exr", "png"), "--format") == ("png", "exr")
    with pytest.raises(SettingsError, match="expected one of: a, b"):
        parse_names("z", ("a", "b"), "--aov")


@pytest.mark.parametrize(("name", "components"), [
    ("normal", 3), ("depth", 1), ("motion", 2), ("position", 3), ("albedo", 3), ("direct", 3)])
def test_previews_are_pictures(name: str, components: int) -> None:
    values = np.linspace(-1, 70000, 4 * 5 * components, dtype=np.float32).reshape(4, 5, components)
    values[0, 0] = np.nan
    shown = preview(name, values, 1.0)
    assert shown.shape == (4, 5, 3)
    assert shown.dtype == np.uint8
    assert shown.min() < shown.max()


def test_the_module_runs_from_anywhere(tmp_path: Path) -> None:
    def run(*args: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, "-P", "-m", "app", *args], cwd=tmp_path, capture_output=True, text=True,
                              check=False, env={**os.environ, "PYTHONPATH": str(ROOT)})

    assert run("--version").stdout.startswith("afterglow ")
    wrong = run("--size", "nonsense")
    assert (wrong.returncode, wrong.stderr) == (
        2, "error: --size: bad size 'nonsense' (expected WIDTHxHEIGHT in pixels, such as 1024x768)\n")


@pytest.mark.parametrize(("redirection", "code"), [
    (">/dev/full", 2), (">&-", 0), ("2>&-", 0), ("| true; exit ${PIPESTATUS[0]}", 1)])
def test_streams_that_are_full_or_closed(redirection: str, code: int) -> None:
    done = subprocess.run(f'"{sys.executable}" -m app models {redirection}', shell=True, executable="/bin/bash",
                          cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == code and done.stderr.count("\n") == (code == 2) and "Traceback" not in done.stderr


@pytest.mark.parametrize(("arguments", "stderr", "message"), [
    (["reference"], "error: off\nnote: x\nerror: a.json: cameras: no key (b) (expected c)\n",
     "a.json: cameras: no key (b) (expected c)"),
    ([], "Traceback ...:\napp.errors.SceneError: a.obj: no such file (expected one)",
     "a.obj: no such file (expected one)"),
    (["onnx", "scaling", "--out", "x"], "Traceback ...:\nKeyError: 'a'",
     "python -m export onnx scaling: failed: KeyError: 'a' (run it in a terminal for all that it prints)"),
    (["reference", "a.obj"], "",
     "python -m export reference: failed: exit code 3 (run it in a terminal for all that it prints)")])
def test_a_failed_child_says_what_its_own_error_says(
        arguments: list[str], stderr: str, message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subprocess, "run", lambda *args, **options: subprocess.CompletedProcess(args, 3, "", stderr))
    with pytest.raises(ProcessError) as caught:
        run_module("export", arguments)
    assert str(caught.value) == message


@pytest.mark.parametrize(("before", "after"), [(None, [ROOT]), ("", [ROOT]), ("/more", [ROOT, "/more"])])
def test_a_child_does_not_import_from_the_working_directory(
        before: str | None, after: list[object], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYTHONPATH", raising=False)
    if before is not None:
        monkeypatch.setenv("PYTHONPATH", before)
    environments = []

    def run(*args: object, env: dict[str, str], **options: object) -> subprocess.CompletedProcess[str]:
        environments.append(env)
        return subprocess.CompletedProcess(args, 0, "", "")

    monkeypatch.setattr(subprocess, "run", run)
    run_module("app")
    assert environments[0]["PYTHONPATH"] == os.pathsep.join(map(str, after))
