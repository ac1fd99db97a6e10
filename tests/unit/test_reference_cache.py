"""The key of a reference, its cache, and what damaged files are answered with."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from app.bench.baselines import recorded_trace
from app.bench.records import reference_record
from app.cli import cli as app_cli
from app.cli.bench import embedded
from app.errors import MissingExtraError, ProcessError, SceneError
from app.evaluation import reference, versions
from app.evaluation.hashing import content_key
from app.io.image import write_exr
from app.load import embedded_scene
from app.paths import data_dir
from app.scene import Scene

GREY = np.full((3, 4, 3), 0.5, np.float32)


def test_the_key_is_that_of_the_content() -> None:
    assert content_key(embedded_scene()) == content_key(embedded_scene())
    assert content_key({"a": 1, "b": 2.0}) == content_key({"b": 2.0, "a": 1})


def test_whatever_changes_the_picture_changes_the_key() -> None:
    scene = embedded_scene()
    mesh = scene.meshes[0]
    moved = mesh.positions.copy()
    moved[3, 1] += 1e-3
    others = [
        embedded_scene(lighting="emissive"), scene.with_lights(), replace(scene, instances=scene.instances[:-1]),
        replace(scene, meshes=(replace(mesh, positions=moved), *scene.meshes[1:])),
        replace(scene, materials=(replace(scene.materials[0], albedo=(0.1, 0.2, 0.3)), *scene.materials[1:])),
    ]
    assert len({content_key(s) for s in [scene, *others]}) == 1 + len(others)
    assert len({content_key(np.zeros(4, np.float32)), content_key(np.zeros((2, 2), np.float32)),
                content_key(np.zeros(4, np.int32)), content_key("0"), content_key(0), content_key(())}) == 6


def test_what_has_no_content_has_no_key() -> None:
    with pytest.raises(TypeError):
        content_key(object())


def black_layers(width: int = 4, height: int = 3) -> dict[str, Any]:
    black = np.zeros((height, width, 3), np.float32)
    return {"": black, "direct": black, "indirect": black, "albedo": black, "depth": black[..., :1]}


class FakeTracer:
    """Writes black layers, and remembers what it was asked for."""

    def __init__(self) -> None:
        self.calls: list[Sequence[str]] = []

    def __call__(self, arguments: Sequence[str]) -> None:
        self.calls.append(arguments)
        out = Path(arguments[arguments.index("--out") + 1])
        write_exr(out / "reference.exr", black_layers())
        (out / "reference.json").write_text(json.dumps({"spp": 8, "noise": {"final": 0.01}, "seconds": 1.0}))


@pytest.fixture
def tracer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> FakeTracer:
    fake = FakeTracer()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(reference, "exporter_version", lambda scene: "1")
    monkeypatch.setattr(reference, "_run", fake)
    return fake


def make(scene: Scene, spp: int = 8) -> reference.Reference:
    request = reference.TraceRequest(Path("box.obj"), "lamp", None, (4, 3))
    return reference.make_reference(request, scene, scene.cameras[scene.default_camera].at(0.0), spp)


def test_the_same_reference_is_made_once(tracer: FakeTracer) -> None:
    first = make(embedded_scene())
    assert first.size == (4, 3) and first.about["spp"] == 8
    assert make(embedded_scene()).key == first.key
    assert tracer.calls[0][:-1] == ["box.obj", "--size", "4x3", "--lighting", "lamp", "--spp", "8", "--out"]
    assert len(tracer.calls) == 1
    make(embedded_scene(), spp=16)
    make(embedded_scene(lighting="emissive"))
    assert len(tracer.calls) == 3


def test_a_variant_is_traced_as_it_is_drawn() -> None:
    request = reference.TraceRequest(Path("shoe.glb"), None, None, (4, 3), "red")
    assert request.arguments == ["shoe.glb", "--size", "4x3", "--variant", "red"]


def test_another_version_of_the_path_tracer_makes_a_new_reference(
        tracer: FakeTracer, monkeypatch: pytest.MonkeyPatch) -> None:
    make(embedded_scene())
    monkeypatch.setattr(reference, "exporter_version", lambda scene: "2")
    make(embedded_scene())
    assert len(tracer.calls) == 2


def test_a_reference_depends_only_on_the_code_that_makes_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = ("__init__.py", "cli.py", "environment_tracer.py", "ggx.py", "path_tracer.py")
    (tmp_path / "reference").mkdir()
    for name in files:
        (tmp_path / "reference" / name).write_text(name)
    monkeypatch.setattr(versions, "require_path_tracer", lambda: tmp_path)
    monkeypatch.setattr(metadata, "version", lambda package: "1")
    before = versions.exporter_version(embedded_scene())
    for name in files:
        (tmp_path / "reference" / name).write_text("changed")
        assert (versions.exporter_version(embedded_scene()) != before) == (name in files[3:]), name
        (tmp_path / "reference" / name).write_text(name)


def test_nothing_that_the_renderer_draws_is_in_what_it_is_judged_by() -> None:
    """The path tracer neither imports the renderer nor OpenGL."""
    pytest.importorskip("mitsuba", reason="the path tracer needs mitsuba")
    code = "import sys, export.reference.trace, export.reference.environment_tracer; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                            cwd=Path(__file__).parents[2]).stdout.split()
    assert "export.reference.path_tracer" in loaded
    assert not [name for name in loaded if name.split(".")[0] == "moderngl"
                or name.startswith(("app.renderer", "app.frame", "app.passes", "app.gl"))]


def test_no_scene_is_compared_with_the_reference_of_another(tmp_path: Path) -> None:
    for scene in ("", "cornell-box"):
        (tmp_path / scene).mkdir(exist_ok=True)
        write_exr(tmp_path / scene / "reference.exr", black_layers(12, 11))
        (tmp_path / scene / "reference.json").write_text("{}")
    line = refused_bench(tmp_path, "--reference", str(tmp_path), "--sizes", "12x11", "--models", "none")
    assert ": no reference of patio (" in line and "expected a folder for each of the 2 scenes" in line


@pytest.mark.parametrize(("option", "said"), [
    (["--lighting", "lamp"], "no lighting 'lamp'"),
    (["--variant", "red"], "no material variant 'red'"),
    (["--models", "unshadowed_environment"], "plain has no environment for unshadowed_environment"),
])
def test_nothing_is_traced_before_all_scenes_are_checked(
        tracer: FakeTracer, tmp_path: Path, option: list[str], said: str) -> None:
    (tmp_path / "plain.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    bulb = {"lights": [{"type": "sphere", "position": [0, 0, 1], "intensity": [1, 1, 1], "radius": 0.1}]}
    (tmp_path / "plain.json").write_text(json.dumps({"lightings": {"bulb": bulb}}))
    scenes = [str(data_dir() / "cornell-box.obj"), str(tmp_path / "plain.obj")]
    if "--models" in option:
        scenes[0] = str(data_dir() / "patio.obj")
    assert said in refused_bench(tmp_path, *scenes, *option)
    assert not tracer.calls


def test_embedded_scenes_are_measured_if_they_have_the_lighting_and_camera() -> None:
    assert [file.stem for file in embedded(None, None)] == ["cornell-box", "patio"]
    assert [file.stem for file in embedded("lamp", "main")] == ["cornell-box"]
    assert [file.stem for file in embedded("sun", None)] == ["patio"]


@pytest.mark.parametrize(("option", "known"), [("--lighting", "lamp, emissive, sky, sun"), ("--camera", "main")])
def test_a_name_that_no_embedded_scene_has_is_refused(tmp_path: Path, option: str, known: str) -> None:
    line = refused_bench(tmp_path, option, "missing", "--models", "none")
    assert option in line and "missing" in line and f"expected one of: {known}" in line


def refused_bench(folder: Path, *args: str) -> str:
    """The one line of error."""
    done = CliRunner().invoke(app_cli, ["bench", *args, "--provider", "cpu", "--out", str(folder / "out")])
    assert done.exit_code == 2, done.output
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    return line


def test_a_reference_that_failed_is_not_kept(tracer: FakeTracer, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(arguments: Sequence[str]) -> None:
        tracer(arguments)
        raise ProcessError("it failed", "here", "expected better")

    monkeypatch.setattr(reference, "_run", fail)
    with pytest.raises(ProcessError):
        make(embedded_scene())
    monkeypatch.setattr(reference, "_run", tracer)
    make(embedded_scene())
    assert len(tracer.calls) == 2


def test_without_path_tracer_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(package: str) -> str:
        raise metadata.PackageNotFoundError(package)

    monkeypatch.setattr(metadata, "version", none)
    with pytest.raises(MissingExtraError, match=r"pip install 'afterglow\[export\]', or --reference DIR"):
        make(embedded_scene())


@pytest.mark.parametrize(("damage", "said"), [
    (lambda folder: (folder / "reference.json").unlink(), "reference.json"),
    (lambda folder: (folder / "reference.json").write_text("[]"), "not a JSON object"),
    (lambda folder: (folder / "reference.json").write_text('{"noise": 3}'), "noise is 3"),
    (lambda folder: (folder / "reference.json").write_text('{"noise": {"final": null}}'), "noise is {'final': None}"),
    (lambda folder: (folder / "reference.json").write_text('{"seconds": "1"}'), "seconds is '1'"),
    (lambda folder: (folder / "reference.json").write_text('{"notices": "fog"}'), "notices are 'fog'"),
    (lambda folder: write_exr(folder / "reference.exr", {"": np.zeros((3, 4, 3), np.float32)}), "no layer 'direct'"),
    (lambda folder: write_exr(folder / "reference.exr", black_layers() | {"": np.full((3, 4, 3), np.nan, np.float32)}),
     "expected finite numbers"),
])
def test_a_damaged_reference_is_refused(tracer: FakeTracer, tmp_path: Path, damage: Any, said: str) -> None:
    tracer(["--out", str(tmp_path)])
    damage(tmp_path)
    with pytest.raises(SceneError, match=said):
        reference.read_reference(tmp_path)


def test_a_damaged_reference_in_the_cache_is_made_again(tracer: FakeTracer) -> None:
    make(embedded_scene())
    (file,) = reference.cache_folder().glob("*/reference.exr")
    file.write_bytes(file.read_bytes()[:50])
    assert make(embedded_scene()).size == (4, 3)
    assert len(tracer.calls) == 2


@pytest.mark.parametrize("text", [
    '{"1": "x"}', '{"one": 1}', '{"1": 0}', '{"1": NaN}', '{"0": 1}', '{"\u00b2": 1}', "[]"])
def test_damaged_pictures_of_a_baseline_are_refused(text: str, tmp_path: Path) -> None:
    write_exr(tmp_path / "baseline_0001.exr", {"": GREY, "albedo": GREY, "normal": GREY})
    (tmp_path / "baselines.json").write_text('{"1": 0.5}')
    assert [(p.spp, p.seconds) for p in reference.read_baseline_images(tmp_path)] == [(1, 0.5)]
    (tmp_path / "baselines.json").write_text(text)
    with pytest.raises(SceneError, match=r"baselines\.json"):
        reference.read_baseline_images(tmp_path)


def test_pictures_of_a_baseline_have_guides_and_the_reference_s_size(tracer: FakeTracer, tmp_path: Path) -> None:
    tracer(["--out", str(tmp_path)])
    stored = reference.read_reference(tmp_path)
    (tmp_path / "baselines.json").write_text('{"1": 0.5}')
    write_exr(tmp_path / "baseline_0001.exr", {"": GREY, "albedo": GREY})
    with pytest.raises(SceneError, match="no layer 'normal'"):
        recorded_trace(tmp_path, stored)
    write_exr(tmp_path / "baseline_0001.exr", {"": GREY, "albedo": GREY, "normal": GREY})
    assert len(recorded_trace(tmp_path, stored)()) == 1
    larger = {name: np.zeros((6, 8, 3), np.float32) for name in ("", "albedo", "normal")}
    write_exr(tmp_path / "baseline_0001.exr", larger)
    with pytest.raises(SceneError, match="not of the reference's size"):
        recorded_trace(tmp_path, stored)


def test_notices_of_the_path_tracer_are_recorded(tracer: FakeTracer, tmp_path: Path) -> None:
    tracer(["--out", str(tmp_path)])
    (tmp_path / "reference.json").write_text('{"notices": ["no fog"]}')
    assert reference_record(reference.read_reference(tmp_path))["notices"] == ["no fog"]
