"""The benchmark's arithmetic, its cache, its comparison and its page; nothing is drawn here."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Sequence
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from app.bench import baselines, configurations, measure, records, reference
from app.bench.baselines import traced_before
from app.bench.headlines import headlines
from app.bench.pareto import Point, Ratio, error_ratio, mean_ratio, pareto_front, speed_up
from app.bench.regressions import compare, read_results
from app.bench.report import html_report
from app.bench.rows import rows, to_csv
from app.bench.run import VERSION
from app.bench.scaling import fit_power
from app.bench.scaling_scene import hall
from app.cli import cli as app_cli
from app.cli.bench import embedded
from app.errors import MissingExtraError, ModelError, PathTracerError, SceneError, SettingsError
from app.evaluation import metrics
from app.evaluation.configurations import Configuration, all_models, at_work, expand, rescaled, sky_models
from app.evaluation.hashing import content_key
from app.evaluation.picture_errors import best_ambient, errors_of
from app.evaluation.timing import Spread, swayed
from app.golden.catalogue import PROBE_ENVIRONMENT
from app.golden.scenes import dusk
from app.io.image import write_exr
from app.load import embedded_scene, load_scene
from app.network.contract import HALF, find_model, read_contract
from app.network.selection import shades_environment
from app.paths import data_dir
from app.scene import Scene
from tests.tiny_network import TINY, write_tiny_network

Json = dict[str, Any]

GREY = np.full((3, 4, 3), 0.5, np.float32)


def curve(*points: tuple[float, float]) -> list[Point]:
    return [Point("baseline", ms, error) for ms, error in points]


# The front and the headline figures.

def test_the_front_is_what_no_other_point_beats() -> None:
    points = curve((4, 0.3), (1, 0.5), (2, 0.6), (4, 0.2), (9, 0.2), (3, 0.5))
    assert [(p.ms, p.error) for p in pareto_front(points)] == [(1, 0.5), (4, 0.2)]


def test_speed_up_is_interpolated_in_logarithms() -> None:
    baseline = curve((10, 0.4), (40, 0.1))
    assert speed_up(Point("ours", 5, 0.2), baseline) == Ratio(pytest.approx(4.0))
    assert speed_up(Point("ours", 40, 0.2), baseline) == Ratio(pytest.approx(0.5))


def test_error_ratio_is_interpolated_in_logarithms() -> None:
    baseline = curve((10, 0.4), (40, 0.1))
    assert error_ratio(Point("ours", 20, 0.1), baseline) == Ratio(pytest.approx(2.0))
    assert error_ratio(Point("ours", 20, 0.4), baseline) == Ratio(pytest.approx(0.5))


def test_nothing_is_extrapolated() -> None:
    baseline = curve((10, 0.4), (40, 0.1))
    assert speed_up(Point("ours", 5, 0.5), baseline) == Ratio(2.0, "≤")      # it is nearer even at its fastest
    assert speed_up(Point("ours", 5, 0.05), baseline) == Ratio(8.0, "≥")     # it never gets that near
    assert error_ratio(Point("ours", 5, 0.2), baseline) == Ratio(2.0, "≥")   # it has no picture yet
    assert error_ratio(Point("ours", 80, 0.2), baseline) == Ratio(0.5, "≤")  # it has long been done


def test_a_point_against_itself_is_one() -> None:
    own = Point("ours", 10, 0.4)
    for baseline in (curve((10, 0.4)), curve((10, 0.4), (40, 0.1))):
        assert speed_up(own, baseline) == error_ratio(own, baseline) == Ratio(1.0)


def test_rival_points_off_its_front_don_t_count() -> None:
    baseline = curve((10, 0.4), (20, 0.9), (40, 0.1), (400, 0.3))
    assert speed_up(Point("ours", 5, 0.2), baseline).value == pytest.approx(4.0)


def test_means_are_geometric_and_keep_their_bound() -> None:
    assert mean_ratio([Ratio(2.0), Ratio(8.0)]) == Ratio(pytest.approx(4.0))
    assert mean_ratio([Ratio(2.0, "≥"), Ratio(8.0)]).bound == "≥"
    assert mean_ratio([Ratio(2.0, "≥"), Ratio(8.0, "≤")]).bound == "≈"


# Times.

def test_a_spread_counts_all_frames_and_keeps_each_turn() -> None:
    spread = Spread.of([[1, 2, 3], [4, 5, 60]])
    assert spread.median == 3.5
    assert spread.p95 == pytest.approx(np.percentile([1, 2, 3, 4, 5, 60], 95))
    assert spread.turns == (2, 5)


class FakeRenderer:
    """Its first two frames of each turn take long."""

    def __init__(self, *_: object) -> None:
        self.device: dict[str, str] = {}
        self.frames = 0

    def __enter__(self) -> FakeRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def reset_timing(self) -> None:
        pass

    def render(self, camera: object, time: float) -> None:
        self.frames += 1

    def timing(self) -> Json:
        return {"passes": {}, "frame": {"cpu_ms": {"median": 90.0 if (self.frames - 1) % 8 < 2 else 1.0}}}


def test_the_first_frames_of_a_turn_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure, "Renderer", FakeRenderer)
    scene = embedded_scene()
    timed_run = measure.TimedRun(scene, scene.cameras[scene.default_camera].at(0.0),
                                  Configuration("none", (), (64, 48)))
    with measure.InterleavedTimer([timed_run], "cpu") as timer:
        timer.turn()
        timer.turn()
    assert [turn["frame"] for turn in timed_run.turns] == [[1.0] * 6] * 2


def test_the_camera_sways_sideways() -> None:
    scene = embedded_scene()
    camera = scene.cameras[scene.default_camera].at(0.0)
    moved = [swayed(camera, scene, frame) for frame in range(1, 4)]
    assert len({c.eye for c in moved}) == 3
    for c in moved:
        shift = np.subtract(c.eye, camera.eye)
        assert 0 < np.linalg.norm(shift) <= 2e-3 * scene.longest_edge
        assert shift @ np.subtract(camera.target, camera.eye) == pytest.approx(0, abs=1e-9)


def test_the_exponent_of_a_power_is_found() -> None:
    counts = [1, 10, 100, 1000]
    fit = fit_power(counts, [3 * n**0.7 for n in counts])
    assert fit.exponent == pytest.approx(0.7)
    assert fit.error == pytest.approx(0, abs=1e-9)
    # By hand: x = 0 … 3 and y = 0, 1, 1, 2 in decades: slope 0.6, squared residuals 0.2, two degrees, Σ(x − x̄)² = 5.
    bent = fit_power(counts, [1, 10, 10, 100])
    assert (bent.exponent, bent.error) == (pytest.approx(0.6), pytest.approx(np.sqrt(0.2 / 2 / 5)))


def test_the_hall_has_what_was_asked_for() -> None:
    for triangles, lights in ((1_000, 1), (10_000, 7), (100_000, 2)):
        scene = hall(triangles, lights)
        assert scene.triangles == pytest.approx(triangles, rel=0.06)
        assert len(scene.lights) == lights
        assert sum(light.intensity[0] for light in scene.lights) == pytest.approx(12)
        assert any(i.motion is not None for i in scene.instances)


# The oracle.

def test_the_best_ambient_is_the_constant_that_was_there() -> None:
    random = np.random.default_rng(2)
    base = random.random((12, 16, 3), np.float32)
    albedo = random.random((12, 16, 3), np.float32)
    constant = np.array([0.3, 0.05, 0.0], np.float32)
    np.testing.assert_allclose(best_ambient(base, albedo, base + albedo * constant), constant, atol=1e-3)


def test_the_best_ambient_may_be_one_bright_channel() -> None:
    black = np.zeros((4, 5, 3), np.float32)
    albedo, red = black + 0.1, np.array([0.6, 0, 0], np.float32)
    albedo[0, :2] = 1  # sets an exposure at which the rest is not white
    np.testing.assert_allclose(best_ambient(black, albedo, albedo * red), red, atol=1e-3)


@pytest.mark.parametrize("scale", [1e-8, 1.0, 1e6])
def test_the_best_strength_of_light_is_found_however_dim_or_coloured(scale: float) -> None:
    light = scale * np.random.default_rng(0).random((8, 8, 3), np.float32) * np.float32([1, 1, 0.02])
    factor = np.float32([2, 0.5, 100])
    np.testing.assert_allclose(best_ambient(0 * light, light, light * factor), factor, rtol=2e-3)


def test_the_best_ambient_is_nearest_in_squared_error() -> None:
    black = np.zeros((1, 10, 3), np.float32)
    final = np.full((1, 10, 3), 0.2, np.float32)
    final[0, :3] = 0.7
    exposure = metrics.exposure_of(final)
    mean = metrics.tone_map(final, exposure).mean(axis=(0, 1))
    np.testing.assert_allclose(metrics.tone_map(best_ambient(black, black + 1, final), exposure), mean, atol=1e-3)


def test_without_light_the_best_ambient_is_none() -> None:
    black = np.zeros((4, 4, 3), np.float32)
    assert best_ambient(black, black + 0.5, black).tolist() == [0, 0, 0]


# Configurations.

def test_models_are_multiplied_out(tmp_path: Path) -> None:
    found, absent = expand(["none", "ssgi", "gather"], [(256, 192), (1024, 768)], [1 / 16, 1 / 4], [], tmp_path)
    assert not absent
    assert [(c.label, c.size) for c in found[:4]] == [(n, (256, 192)) for n in (
        "none", "ssgi", "gather at 1/16", "gather at 1/4")]
    assert [c.grid for c in found[4:]] == [None, None, (64, 48), (256, 192)]
    assert [c.precision for c in found[:4]] == [None, None, "float32", "float32"]


def test_only_precisions_that_exist_are_measured() -> None:
    found, absent = expand(["none", "gather"], [(64, 48)], [], ["float32", "float16"])
    assert [c.label for c in found] == ["none", "gather float32"]
    assert absent == ["gather in float16 is not available (there is no gather-half.onnx of that type)"]


def test_a_variant_in_half_precision_is_found_beside_its_network(tmp_path: Path) -> None:
    single, half = tmp_path / "mine.onnx", tmp_path / f"mine{HALF}.onnx"
    write_tiny_network(single)
    write_tiny_network(half, replace(TINY, dtype="float16").to_json())
    for file in (single, half):
        found, absent = expand([str(file)], [(64, 48)], [], ["float32", "float16"])
        assert not absent and [(c.label, c.file, c.precision) for c in found] == [
            ("mine float32", single, "float32"), ("mine float16", half, "float16")]
    with pytest.raises(ModelError, match="two models are called 'mine float32'"):
        expand([str(single), str(half)], [(64, 48)], [], ["float32"])


def test_all_models_has_each_network_once(monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("both", f"both{HALF}", f"half{HALF}")
    monkeypatch.setattr(configurations, "bundled_models", lambda: dict.fromkeys(names, find_model("gather")))
    assert all_models() == ("none", "ssgi", "both", f"half{HALF}")
    monkeypatch.setattr(configurations, "bundled_models", lambda: {"sky": PROBE_ENVIRONMENT})
    assert all_models() == ("none", "ssgi"), "what shades an environment makes no indirect light"


def test_two_models_can_draw_together(tmp_path: Path) -> None:
    sky, half = tmp_path / "sky.onnx", tmp_path / f"sky{HALF}.onnx"
    for file in (sky, half):
        file.write_bytes(PROBE_ENVIRONMENT.read_bytes())
    found, absent = expand(["ember+unshadowed_environment", f"gather + {sky}", "none+unshadowed_environment"], [(64, 48)], [1 / 4], [], tmp_path)
    assert not absent
    assert [c.label for c in found] == ["ember+unshadowed_environment at 1/4", "gather+sky at 1/4", "unshadowed_environment"]
    scales = [[read_contract(m).scale for m in c.models if isinstance(m, Path)] for c in found]
    assert scales == [[1 / 4], [1 / 4, 1 / 4], []]
    assert all(c.shades_environment for c in found)
    found, absent = expand([f"gather+{sky}"], [(64, 48)], [], ["float32", "float16"])
    assert [(c.label, c.precision) for c in found] == [("gather+sky float32", "float32")]
    assert absent == ["gather+sky in float16 is not available (there is no gather-half.onnx of that type)"]


def test_a_plus_may_be_in_a_file_s_name(tmp_path: Path) -> None:
    write_tiny_network(tmp_path / "mine+yours.onnx")
    (found,), _ = expand([str(tmp_path / "mine+yours.onnx")], [(64, 48)])
    assert found.label == "mine+yours" and found.models == (tmp_path / "mine+yours.onnx",)


def test_a_plus_may_be_in_the_path_of_one_of_a_pair(tmp_path: Path) -> None:
    (tmp_path / "a+b").mkdir()
    sky = tmp_path / "a+b" / "sky.onnx"
    sky.write_bytes(PROBE_ENVIRONMENT.read_bytes())
    for text in (f"ember+{sky}", f" {sky} + ember"):
        (found,), _ = expand([text], [(64, 48)])
        assert found.label == "ember+sky" and found.models == (find_model("ember"), sky)


@pytest.mark.parametrize("texts", [
    ["ssgi", "{}/ssgi.onnx"], ["{}/ssgi.onnx", "ssgi"], ["unshadowed_environment", "none+unshadowed_environment"], ["ssgi+unshadowed_environment", "unshadowed_environment+ssgi"],
    ["gather+unshadowed_environment", "unshadowed_environment+gather"],
])
def test_nothing_is_measured_twice_or_lost_to_another_of_its_name(tmp_path: Path, texts: list[str]) -> None:
    write_tiny_network(tmp_path / "ssgi.onnx")
    with pytest.raises(ModelError, match="two models are called"):
        expand([text.format(tmp_path) for text in texts], [(64, 48)])


def test_two_rescaled_networks_of_one_stem_are_two(tmp_path: Path) -> None:
    sky, own = tmp_path / "sky" / "net.onnx", tmp_path / "net.onnx"
    sky.parent.mkdir()
    sky.write_bytes(PROBE_ENVIRONMENT.read_bytes())
    write_tiny_network(own)
    (found,), _ = expand([f"{own}+{sky}"], [(64, 48)], [1 / 4], [], tmp_path)
    assert found.label == "net+net at 1/4"
    assert [shades_environment(model) for model in found.models] == [False, True]


@pytest.mark.parametrize(("command", "models", "said"), [
    ("bench", "gathr", "error: no network 'gathr', --models, expected"),
    ("compare", "gathr,reference", "error: no network 'gathr', --models, expected"),
    ("compare", "none", "error: nothing to compare in 'none'"),
    ("compare", "reference", "error: nothing to compare in 'reference'"),
    ("compare", "none,none+none", "error: two models are called 'none'"),
])
def test_what_models_can_t_be_taken_is_said_of_the_option_that_there_is(command: str, models: str, said: str) -> None:
    done = CliRunner().invoke(app_cli, [command, "--models", models, "--provider", "cpu"])
    assert done.exit_code == 2 and said in done.stderr


def test_ember_is_measured_beside_all_that_shades_a_sky(monkeypatch: pytest.MonkeyPatch) -> None:
    assert sky_models()[0] == "ember+unshadowed_environment"
    files = dict.fromkeys(("sky", f"sky{HALF}"), PROBE_ENVIRONMENT)
    monkeypatch.setattr(configurations, "bundled_models", lambda: files)
    assert sky_models() == ("ember+unshadowed_environment", "ember+sky")


@pytest.mark.parametrize(("lighting", "lights"), [("sky", 0), ("sun", 1)])
def test_the_embedded_patio_is_under_a_sky(lighting: str, lights: int) -> None:
    patio = load_scene(data_dir() / "patio.obj", lighting=lighting)
    assert patio.environment is not None and len(patio.lights) == lights and not patio.notices
    assert any(m.has_specular for m in patio.materials) and not all(m.has_specular for m in patio.materials)


def test_what_shades_a_sky_is_idle_without_one() -> None:
    found, _ = expand(["none", "unshadowed_environment", "ember+unshadowed_environment"], [(64, 48)])
    box = embedded_scene()
    measured, idle = at_work(found, box)
    assert [c.label for c in measured] == ["none"] and idle == ["unshadowed_environment", "ember+unshadowed_environment"]
    assert at_work(found, replace(box, environment=dusk().environment)) == (found, [])


def test_scales_are_told_apart(tmp_path: Path) -> None:
    scales = [1 / 3, 0.001, 0.002, 0.0000001, 0.0000002]
    found, _ = expand(["gather"], [(64, 48)], scales, [], tmp_path)
    assert [c.label for c in found] == [f"gather at {s}" for s in ("1/3", "0.001", "0.002", "1e-07", "2e-07")]
    assert [read_contract(c.file).scale for c in found if isinstance(c.file, Path)] == scales


def test_a_rescaled_network_is_the_same_but_for_its_scale(tmp_path: Path) -> None:
    network = find_model("gather")
    assert isinstance(network, Path)
    contract = read_contract(rescaled(network, 0.25, tmp_path))
    assert contract == replace(read_contract(network), scale=0.25)


def test_models_that_can_t_be_told_apart_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="no network 'gathr'"):
        expand(["gathr"], [(64, 48)])
    network = find_model("gather")
    assert isinstance(network, Path)
    (tmp_path / "gather.onnx").write_bytes(network.read_bytes())
    with pytest.raises(ModelError, match="two models are called 'gather'"):
        expand(["gather", str(tmp_path / "gather.onnx")], [(64, 48)])


# The key of a reference, and its cache.

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
    order = reference.Order(Path("box.obj"), "lamp", None, (4, 3))
    return reference.make_reference(order, scene, scene.cameras[scene.default_camera].at(0.0), spp)


def test_the_same_reference_is_made_once(tracer: FakeTracer) -> None:
    first = make(embedded_scene())
    assert first.size == (4, 3) and first.about["spp"] == 8
    assert make(embedded_scene()).key == first.key
    assert tracer.calls[0][:-1] == ["box.obj", "--size", "4x3", "--lighting", "lamp", "--spp", "8", "--out"]
    assert len(tracer.calls) == 1
    make(embedded_scene(), spp=16)
    make(embedded_scene(lighting="emissive"))
    assert len(tracer.calls) == 3


def test_another_path_tracer_makes_the_reference_anew(tracer: FakeTracer, monkeypatch: pytest.MonkeyPatch) -> None:
    make(embedded_scene())
    monkeypatch.setattr(reference, "exporter_version", lambda scene: "2")
    make(embedded_scene())
    assert len(tracer.calls) == 2


def test_no_scene_is_judged_by_the_reference_of_another(tmp_path: Path) -> None:
    for scene in ("", "cornell-box"):
        (tmp_path / scene).mkdir(exist_ok=True)
        write_exr(tmp_path / scene / "reference.exr", black_layers(12, 11))
        (tmp_path / scene / "reference.json").write_text("{}")
    line = refused_bench(tmp_path, "--reference", str(tmp_path), "--sizes", "12x11", "--models", "none")
    assert line.startswith("error: no reference of patio, ") and "expected a folder for each of the 2 scenes" in line


@pytest.mark.parametrize(("option", "said"), [
    (["--lighting", "lamp"], "no lighting 'lamp'"),
    (["--models", "unshadowed_environment"], "plain has no environment for unshadowed_environment"),
])
def test_nothing_is_traced_before_all_scenes_are_found_sound(
        tracer: FakeTracer, tmp_path: Path, option: list[str], said: str) -> None:
    (tmp_path / "plain.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    scenes = [str(data_dir() / "cornell-box.obj"), str(tmp_path / "plain.obj")]
    if "--models" in option:
        scenes[0] = str(data_dir() / "patio.obj")
    assert said in refused_bench(tmp_path, *scenes, *option)
    assert not tracer.calls


def test_of_the_embedded_scenes_those_are_measured_that_have_what_is_named() -> None:
    assert [file.stem for file in embedded(None, None)] == ["cornell-box", "patio"]
    assert [file.stem for file in embedded("lamp", "main")] == ["cornell-box"]
    assert [file.stem for file in embedded("sun", None)] == ["patio"]


@pytest.mark.parametrize(("option", "known"), [("--lighting", "lamp, emissive, sky, sun"), ("--camera", "main")])
def test_what_no_embedded_scene_has_is_refused(tmp_path: Path, option: str, known: str) -> None:
    line = refused_bench(tmp_path, option, "missing", "--models", "none")
    assert option in line and "missing" in line and f"expected one of {known}" in line


def refused_bench(folder: Path, *args: str) -> str:
    """The one line of error."""
    done = CliRunner().invoke(app_cli, ["bench", *args, "--provider", "cpu", "--out", str(folder / "out")])
    assert done.exit_code == 2, done.output
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    return line


def test_a_reference_that_failed_is_not_kept(tracer: FakeTracer, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(arguments: Sequence[str]) -> None:
        tracer(arguments)
        raise PathTracerError("it failed", "here", "expected better")

    monkeypatch.setattr(reference, "_run", fail)
    with pytest.raises(PathTracerError):
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
    (lambda folder: (folder / "reference.json").write_text("[]"), "no JSON object"),
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


def test_a_damaged_reference_in_the_cache_is_made_anew(tracer: FakeTracer) -> None:
    make(embedded_scene())
    (file,) = reference.cache_folder().glob("*/reference.exr")
    file.write_bytes(file.read_bytes()[:50])
    assert make(embedded_scene()).size == (4, 3)
    assert len(tracer.calls) == 2


@pytest.mark.parametrize("text", [
    '{"1": "x"}', '{"one": 1}', '{"1": 0}', '{"1": NaN}', '{"0": 1}', '{"\u00b2": 1}', "[]"])
def test_damaged_pictures_of_a_rival_are_refused(text: str, tmp_path: Path) -> None:
    write_exr(tmp_path / "plain_0001.exr", {"": GREY, "albedo": GREY, "normal": GREY})
    (tmp_path / "plain.json").write_text('{"1": 0.5}')
    assert [(p.spp, p.seconds) for p in reference.read_plain(tmp_path)] == [(1, 0.5)]
    (tmp_path / "plain.json").write_text(text)
    with pytest.raises(SceneError, match=r"plain\.json"):
        reference.read_plain(tmp_path)


def test_pictures_of_a_rival_have_their_guides_and_the_reference_s_size(tracer: FakeTracer, tmp_path: Path) -> None:
    tracer(["--out", str(tmp_path)])
    found = reference.read_reference(tmp_path)
    (tmp_path / "plain.json").write_text('{"1": 0.5}')
    write_exr(tmp_path / "plain_0001.exr", {"": GREY, "albedo": GREY})
    with pytest.raises(SceneError, match="no layer 'normal'"):
        traced_before(tmp_path, found)
    write_exr(tmp_path / "plain_0001.exr", {"": GREY, "albedo": GREY, "normal": GREY})
    assert len(traced_before(tmp_path, found)()) == 1
    larger = {name: np.zeros((6, 8, 3), np.float32) for name in ("", "albedo", "normal")}
    write_exr(tmp_path / "plain_0001.exr", larger)
    with pytest.raises(SceneError, match="not of the reference's size"):
        traced_before(tmp_path, found)


def test_what_the_path_tracer_did_not_draw_is_kept(tracer: FakeTracer, tmp_path: Path) -> None:
    tracer(["--out", str(tmp_path)])
    (tmp_path / "reference.json").write_text('{"notices": ["no fog"]}')
    assert records.reference(reference.read_reference(tmp_path))["notices"] == ["no fog"]


def test_where_no_surface_is_seen_indirect_light_is_not_judged(tracer: FakeTracer) -> None:
    nothing = reference.Reference({name: np.zeros((12, 16, 1 if name == "depth" else 3), np.float32)
                           for name in reference.LAYERS}, {}, "k")
    assert set(errors_of(nothing.layers, nothing)) == {"direct", "final"}


@pytest.mark.parametrize("sizes", ["8x6", "64x48,64x10"])
def test_sizes_below_the_window_of_ssim_are_refused(sizes: str) -> None:
    done = CliRunner().invoke(app_cli, ["bench", "--sizes", sizes])
    assert done.exit_code == 2 and "expected sides of at least 11" in done.output


# Rivals.

def test_a_denoised_picture_takes_tracing_and_the_median_denoising(monkeypatch: pytest.MonkeyPatch) -> None:
    took = {"fast": iter([9.0, 0.1, 0.2, 0.3, 7.0, 0.2]), "high": iter([9.0, 1.0, 1.0, 1.0, 1.0, 1.0])}
    now = 0.0

    def denoise(plain: reference.Plain, quality: str) -> Any:
        nonlocal now
        now += next(took[quality])
        return plain.final / 2

    monkeypatch.setattr(baselines, "denoise", denoise)
    monkeypatch.setattr(baselines, "perf_counter", lambda: now)
    found = baselines.draw_baselines(lambda: [reference.Plain(4, 2.0, GREY, GREY, GREY)])
    assert [(r.name, r.spp, r.ms) for r in found] == [
        ("path tracer", 4, 2000), ("denoised (fast)", 4, pytest.approx(2200)), ("denoised (high)", 4, 3000)]
    assert [r.picture.max() for r in found] == [0.5, 0.25, 0.25]


@pytest.mark.parametrize("option", [
    ["--seed", "32"], ["--max-bounces", "1001"], ["--plain", "32769"], ["--plain", "²"]])
def test_the_path_tracer_refuses_what_it_can_t_count(option: list[str], tmp_path: Path) -> None:
    pytest.importorskip("mitsuba")
    from export.__main__ import cli as export_cli

    done = CliRunner().invoke(export_cli, ["reference", "--out", str(tmp_path), *option])
    assert done.exit_code == 2 or isinstance(done.exception, SettingsError)


# Results: comparison, table, page.

def configuration(label: str, ms: float, flip: float, grid: list[int] | None) -> Json:
    errors = {"flip": flip, "psnr": 30.0, "ssim": 0.9, "rel_mse": 0.1}
    return {"label": label, "size": [4, 3], "grid": grid, "precision": grid and "float32",
            "errors": {layer: dict(errors) for layer in ("direct", "indirect", "final")},
            "device": {"gl_renderer": "soft", "gl_version": "4.5", "provider": "cpu"},
            "fresh": {"startup_s": 0.5, "peak_mb": 250.0},
            "stages": {n: times(m) for n, m in (("direct", ms / 2), ("tiny", 0.01), ("copy", 1.0), ("frame", ms))}}


def times(ms: float) -> Json:
    return {"median": ms, "p95": 2 * ms, "turns": [f * ms for f in (1, 1.01, 0.99, 1.005, 0.995)]}


def slow(stages: Json, factor: float, *names: str) -> None:
    for name in names:
        stages[name] = times(factor * stages[name]["median"])


def baseline(name: str, spp: int, ms: float, flip: float) -> Json:
    return {"name": name, "spp": spp, "ms": ms,
            "errors": {"final": {"flip": flip, "psnr": 30.0, "ssim": 0.9, "rel_mse": 0.1}}}


@pytest.fixture
def results() -> Json:
    scene = {
        "name": "<box>", "lighting": "lamp", "camera": "main", "triangles": 32, "lights": 1, "yardstick": times(4.0),
        "reference": {"spp": 8, "noise": {"final": 0.01}, "notices": ["no fog"], "size": [4, 3], "key": "k"},
        "configurations": [configuration("none", 5.0, 0.5, None), configuration("net", 10.0, 0.2, [2, 2])],
        "ambient": {"constant": [1, 1, 1],
                    "errors": {"final": {"flip": 0.3, "psnr": None, "ssim": 1.0, "rel_mse": 0.0}}},
        "baselines": [baseline("path tracer", 1, 20, 0.4), baseline("path tracer", 4, 80, 0.1),
                   baseline("denoised (fast)", 1, 30, 0.1)],
    }
    return {"version": VERSION, "command": "bench", "absent": [], "seconds": 3.0, "scenes": [scene],
            "headlines": headlines([scene]),
            "machine": {"processor": "cpu", "cores": 2, "physical_cores": 2, "memory_gb": 8.0, "system": "Linux",
                        "python": "3.11", "load_average": 0.1, "versions": {"numpy": "2"}}}


def test_the_headline_is_against_every_rival(results: Json) -> None:
    found = {row["against"]: row for row in results["headlines"]}
    assert set(found) == {"path tracer", "path tracer, denoised"}
    assert found["path tracer"]["speed_up"] == {"value": pytest.approx(4.0), "bound": ""}
    assert found["path tracer"]["error_ratio"] == {"value": pytest.approx(2.0), "bound": "≥"}
    assert found["path tracer, denoised"]["speed_up"] == {"value": pytest.approx(3.0), "bound": "≤"}


def test_equal_results_show_no_change(results: Json) -> None:
    assert compare(results, results) == ([], [])


def test_what_became_slower_beyond_noise_is_named(results: Json) -> None:
    new = copy.deepcopy(results)
    stages = new["scenes"][0]["configurations"][1]["stages"]
    slow(stages, 1.025, "frame")
    slow(stages, 1.10, "direct")
    slow(stages, 4.0, "tiny")
    slow(new["scenes"][0]["configurations"][0]["stages"], 1.10, "direct", "frame")
    changes, notes = compare(results, new)
    assert not notes
    assert [(c.where, c.figure, c.worse) for c in changes] == [
        ("<box>, none at 4x3", "direct ms", True), ("<box>, none at 4x3", "frame ms", True),
        ("<box>, net at 4x3", "direct ms", True)]
    assert not any(change.worse for change in compare(new, results)[0])


def test_equal_programs_seldom_differ_and_slower_ones_do(results: Json) -> None:
    random = np.random.default_rng(5)
    first = results["scenes"][0]["configurations"][0]

    def run(scatter: float, slower: float = 1.0) -> Json:
        """A hundred stages in five turns."""
        drawn = {f"stage {i}": slower * random.lognormal(0, scatter, 5) for i in range(100)}
        stages = {n: {"median": float(np.median(t)), "turns": t.tolist()} for n, t in drawn.items()}
        return results | {"scenes": [results["scenes"][0] | {
            "configurations": [first | {"stages": stages | {"copy": times(1.0), "frame": times(5.0)}}]}]}

    for scatter in (0.02, 0.1):
        assert sum(bool(compare(run(scatter), run(scatter))[0]) for _ in range(30)) <= 3
    assert len(compare(run(0.01), run(0.01, slower=1.1))[0]) > 95


def test_a_few_turns_tell_nothing(results: Json) -> None:
    new = copy.deepcopy(results)
    for c in new["scenes"][0]["configurations"]:
        slow(c["stages"], 9, "direct")
        for stage in c["stages"].values():
            stage["turns"] = stage["turns"][:4]
    assert compare(results, new) == ([], ["times of fewer than 5 turns are not compared"])


@pytest.mark.parametrize(("key", "value"), [("lighting", "sun"), ("camera", "side"), ("triangles", 33), ("lights", 2)])
def test_another_picture_is_not_compared(results: Json, key: str, value: object) -> None:
    new = copy.deepcopy(results)
    new["scenes"][0][key] = value
    slow(new["scenes"][0]["configurations"][0]["stages"], 9, "direct")
    new["scenes"][0]["configurations"][0]["errors"]["final"]["flip"] *= 3
    assert compare(results, new) == ([], [f"<box> has other {key}: it is not compared"])


def test_times_of_another_device_are_not_compared(results: Json) -> None:
    for key in ("gl_renderer", "provider"):
        new = copy.deepcopy(results)
        for c in new["scenes"][0]["configurations"]:
            slow(c["stages"], 0.1, "direct", "frame")
            c["device"][key] = "another"
        changes, (note,) = compare(results, new)
        assert not changes and "another" in note and "are not compared with times on soft with provider cpu" in note


def test_a_loaded_machine_is_noted(results: Json) -> None:
    new = copy.deepcopy(results)
    new["machine"]["load_average"] = 3.5
    assert "this run began under a load of 3.5 on 2 cores" in compare(results, new)[1][0]
    assert "the earlier run began" in compare(new, results)[1][0]


@pytest.mark.parametrize("by", ["copy", "processor"])
def test_what_a_slower_machine_explains_is_no_change(results: Json, by: str) -> None:
    new = copy.deepcopy(results)
    for c in new["scenes"][0]["configurations"]:
        slow(c["stages"], 1.5, "direct", "frame", *(["copy"] if by == "copy" else []))
    if by == "processor":
        slow(new["scenes"][0], 1.5, "yardstick")
    changes, notes = compare(results, new)
    assert not changes
    assert "the yardsticks moved by 50%" in notes[0]
    slow(new["scenes"][0]["configurations"][1]["stages"], 1.2, "direct")
    assert [c.figure for c in compare(results, new)[0]] == ["direct ms"]


def test_what_became_worse_is_named(results: Json) -> None:
    new = copy.deepcopy(results)
    final = new["scenes"][0]["configurations"][0]["errors"]["final"]
    final["flip"] *= 1.02
    final["psnr"] += 0.5
    final["ssim"] -= 0.0005
    changes, _ = compare(results, new)
    assert {(c.figure, c.worse) for c in changes} == {("final flip", True), ("final psnr", False)}


def test_times_of_another_machine_are_not_compared(results: Json) -> None:
    new = copy.deepcopy(results)
    new["machine"]["processor"] = "another"
    slow(new["scenes"][0]["configurations"][1]["stages"], 9, "direct")
    new["scenes"][0]["reference"]["key"] = "other"
    new["scenes"][0]["configurations"][1]["errors"]["final"]["flip"] *= 3
    changes, notes = compare(results, new)
    assert not changes
    assert len(notes) == 2 and "times are not compared" in notes[0] and "another reference" in notes[1]


def test_what_is_new_or_gone_is_noted(results: Json) -> None:
    new = copy.deepcopy(results)
    new["scenes"][0]["configurations"].append(configuration("fresh", 1.0, 0.1, None))
    new["scenes"][0]["configurations"][0]["stages"]["fog"] = times(50.0)
    assert compare(results, new) == ([], ["<box>, fresh at 4x3 is new", "<box>, none at 4x3, fog is new"])
    assert compare(new, results) == ([], ["<box>, fresh at 4x3 is gone", "<box>, none at 4x3, fog is gone"])
    assert compare(results, results | {"scenes": []}) == ([], ["<box> is gone"])


@pytest.mark.parametrize("text", ["", "[]", '{"version": 0}', f'{{"version": {VERSION}}}'])
def test_only_results_can_be_compared_with(text: str, tmp_path: Path) -> None:
    (tmp_path / "old.json").write_text(text)
    with pytest.raises(SettingsError, match=r"expected the bench\.json of a run"):
        read_results(tmp_path / "old.json")


def test_a_result_that_lacks_something_can_t_be_compared_with(results: Json, tmp_path: Path) -> None:
    (tmp_path / "old.json").write_text(json.dumps(results))
    assert read_results(tmp_path / "old.json") == results
    del results["scenes"][0]["configurations"][1]["stages"]["frame"]["turns"]
    (tmp_path / "old.json").write_text(json.dumps(results))
    with pytest.raises(SettingsError, match="no result of this version"):
        read_results(tmp_path / "old.json")


def test_the_table_has_a_row_for_everything(results: Json) -> None:
    lines = to_csv(rows(results)).splitlines()
    assert len(lines) == 1 + 2 + 1 + 3
    header = lines[0].split(",")
    assert {"scene", "label", "frame.median_ms", "frame.p95_ms", "final.flip", "indirect.psnr", "spp",
            "startup_s", "peak_mb"} <= set(header)
    assert dict(zip(header, lines[2].split(","), strict=True))["frame.median_ms"] == "10.0"


def test_the_page_needs_no_other_file(results: Json) -> None:
    image = np.full((12, 16, 3), 0.5, np.float32)
    results["growth"] = {"model": "net", "sweeps": {"lights": {
        "counts": [1, 2], "stages": {"frame": {"ms": [1.0, 2.0], "exponent": 1.0, "error": 0.0},
                                     "tiny": {"ms": [0.01, 0.01], "exponent": None, "error": None}}}}}
    page = html_report(results, {"<box>": {"reference": image, "net": image * 2}})
    assert "<box>" not in re.sub(r"<script>.*</script>", "", page, flags=re.S)  # names are escaped
    assert not re.search(r"(src|href)\s*=\s*[\"'](?!data:|#)", page)
    assert page.count("</script>") == 1
    for text in ("Speed-up at equal error", "4×", "≥2×", "path tracer, 4 spp", "1.00 ± 0.00", "cpu, 2 logical",
                 "; no fog"):
        assert text in page
    pictures = json.loads(re.search(r"const pictures = (.*);\n", page)[1])  # type: ignore[index]
    assert set(pictures["<box>"]["net"]) == {"picture", "flip"}
    assert pictures["<box>"]["net"]["picture"].startswith("data:image/webp;base64,")


def test_the_same_results_make_the_same_page(results: Json) -> None:
    image = {"<box>": {"reference": np.full((12, 16, 3), 0.5, np.float32)}}
    assert html_report(results, image) == html_report(results, image)
