"""Configurations: combinations of models, sizes, scales and precisions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import cli as app_cli
from app.errors import ModelError, SettingsError
from app.evaluation.configurations import expand, select_applicable
from app.golden.catalogue import PROBE_ENVIRONMENT
from app.golden.scenes import dusk
from app.load import embedded_scene, load_scene
from app.network import selection
from app.network.contract_json import contract_to_json, read_contract
from app.network.selection import (
    DEFAULT_MODEL,
    HALF_SUFFIX,
    UNSHADOWED,
    all_models,
    find_model,
    load_models,
    shades_environment,
    sky_models,
)
from app.network.session import Network
from app.paths import data_dir
from app.settings import Settings
from tests.tiny_network import TINY, write_tiny_network


def test_all_combinations_are_listed(tmp_path: Path) -> None:
    configurations, absent = expand(["none", "ssgi", "gather"], [(256, 192), (1024, 768)], [1 / 16, 1 / 4])
    assert not absent
    assert [(c.label, c.size) for c in configurations[:4]] == [(n, (256, 192)) for n in (
        "none", "ssgi", "gather at 1/16", "gather at 1/4")]
    assert [c.grid for c in configurations[4:]] == [None, None, (64, 48), (256, 192)]
    assert [c.precision for c in configurations[:4]] == [None, None, "float32", "float32"]


def test_only_precisions_that_exist_are_measured() -> None:
    configurations, absent = expand(["none", "gather"], [(64, 48)], [], ["float32", "float16"])
    assert [c.label for c in configurations] == ["none", "gather float32"]
    assert absent == ["gather in float16 is not available (there is no gather-half.onnx of that type)"]


def test_a_variant_in_half_precision_is_found_beside_its_network(tmp_path: Path) -> None:
    single, half = tmp_path / "mine.onnx", tmp_path / f"mine{HALF_SUFFIX}.onnx"
    write_tiny_network(single)
    write_tiny_network(half, contract_to_json(replace(TINY, dtype="float16")))
    for file in (single, half):
        configurations, absent = expand([str(file)], [(64, 48)], [], ["float32", "float16"])
        assert not absent and [(c.label, c.file, c.precision) for c in configurations] == [
            ("mine float32", single, "float32"), ("mine float16", half, "float16")]
    with pytest.raises(ModelError, match="two models are called 'mine float32'"):
        expand([str(single), str(half)], [(64, 48)], [], ["float32"])


def test_all_models_has_each_network_once(monkeypatch: pytest.MonkeyPatch) -> None:
    names, network = ("both", f"both{HALF_SUFFIX}", f"half{HALF_SUFFIX}"), find_model("gather")
    monkeypatch.setattr(selection, "bundled_models", lambda: dict.fromkeys(names, network))
    assert all_models() == ("none", "ssgi", "both", f"half{HALF_SUFFIX}")
    monkeypatch.setattr(selection, "bundled_models", lambda: {"sky": PROBE_ENVIRONMENT})
    assert all_models() == ("none", "ssgi"), "a model that shades an environment computes no indirect light"


def test_two_models_can_draw_together(tmp_path: Path) -> None:
    sky, half = tmp_path / "sky.onnx", tmp_path / f"sky{HALF_SUFFIX}.onnx"
    for file in (sky, half):
        file.write_bytes(PROBE_ENVIRONMENT.read_bytes())
    pairs = [f"ember+{UNSHADOWED}", f"gather + {sky}", f"none+{UNSHADOWED}"]
    configurations, absent = expand(pairs, [(64, 48)], [1 / 4])
    assert not absent
    assert [c.label for c in configurations] == [f"ember+{UNSHADOWED} at 1/4", "gather+sky at 1/4", UNSHADOWED]
    assert [c.scale for c in configurations] == [1 / 4, 1 / 4, None]
    assert all(c.shades_environment for c in configurations)
    configurations, absent = expand([f"gather+{sky}"], [(64, 48)], [], ["float32", "float16"])
    assert [(c.label, c.precision) for c in configurations] == [("gather+sky float32", "float32")]
    assert absent == ["gather+sky in float16 is not available (there is no gather-half.onnx of that type)"]


def test_a_plus_may_be_in_a_file_s_name(tmp_path: Path) -> None:
    write_tiny_network(tmp_path / "mine+yours.onnx")
    (configurations,), _ = expand([str(tmp_path / "mine+yours.onnx")], [(64, 48)])
    assert configurations.label == "mine+yours" and configurations.models == (tmp_path / "mine+yours.onnx",)


def test_a_plus_may_be_in_the_path_of_one_of_a_pair(tmp_path: Path) -> None:
    (tmp_path / "a+b").mkdir()
    sky = tmp_path / "a+b" / "sky.onnx"
    sky.write_bytes(PROBE_ENVIRONMENT.read_bytes())
    for text in (f"ember+{sky}", f" {sky} + ember"):
        (configurations,), _ = expand([text], [(64, 48)])
        assert configurations.label == "ember+sky" and configurations.models == (find_model("ember"), sky)


@pytest.mark.parametrize("texts", [
    ["ssgi", "{}/ssgi.onnx"], ["{}/ssgi.onnx", "ssgi"], [UNSHADOWED, f"none+{UNSHADOWED}"],
    [f"ssgi+{UNSHADOWED}", f"{UNSHADOWED}+ssgi"], [f"gather+{UNSHADOWED}", f"{UNSHADOWED}+gather"],
])
def test_models_with_the_same_label_are_refused(tmp_path: Path, texts: list[str]) -> None:
    write_tiny_network(tmp_path / "ssgi.onnx")
    with pytest.raises(ModelError, match="two models are called"):
        expand([text.format(tmp_path) for text in texts], [(64, 48)])


def test_two_networks_of_one_stem_are_two(tmp_path: Path) -> None:
    sky, own = tmp_path / "sky" / "net.onnx", tmp_path / "net.onnx"
    sky.parent.mkdir()
    sky.write_bytes(PROBE_ENVIRONMENT.read_bytes())
    write_tiny_network(own)
    (configurations,), _ = expand([f"{own}+{sky}"], [(64, 48)], [1 / 4])
    assert configurations.label == "net+net at 1/4"
    assert [shades_environment(model) for model in configurations.models] == [False, True]


@pytest.mark.parametrize(("command", "models", "said"), [
    ("bench", "gathr", "error: --models: no model 'gathr' (did you mean 'gather'? expected"),
    ("compare", "gathr,reference", "error: --models: no model 'gathr' (did you mean 'gather'? expected"),
    ("compare", "none", "error: --models: nothing to compare in 'none'"),
    ("compare", "reference", "error: --models: nothing to compare in 'reference'"),
    ("compare", "none,none+none", "error: none+none: two models are called 'none'"),
])
def test_bad_models_are_refused_by_the_name_of_the_option(command: str, models: str, said: str) -> None:
    done = CliRunner().invoke(app_cli, [command, "--models", models, "--provider", "cpu"])
    assert done.exit_code == 2 and said in done.stderr


def test_the_default_model_is_measured_beside_models_that_shade_skies(monkeypatch: pytest.MonkeyPatch) -> None:
    assert sky_models()[0] == f"{DEFAULT_MODEL}+unshadowed_environment"
    files = dict.fromkeys(("sky", f"sky{HALF_SUFFIX}"), PROBE_ENVIRONMENT)
    monkeypatch.setattr(selection, "bundled_models", lambda: files)
    assert sky_models() == (f"{DEFAULT_MODEL}+unshadowed_environment", f"{DEFAULT_MODEL}+sky")


@pytest.mark.parametrize(("lighting", "lights"), [("sky", 0), ("sun", 1)])
def test_the_embedded_patio_is_under_a_sky(lighting: str, lights: int) -> None:
    patio = load_scene(data_dir() / "patio.obj", lighting=lighting)
    assert patio.environment is not None and len(patio.lights) == lights and not patio.notices
    assert any(m.has_specular for m in patio.materials) and not all(m.has_specular for m in patio.materials)


def test_models_that_shade_an_environment_are_skipped_without_one() -> None:
    every, _ = expand(["none", UNSHADOWED, f"ember+{UNSHADOWED}"], [(64, 48)])
    box = embedded_scene()
    measured, skipped = select_applicable(every, box)
    assert [c.label for c in measured] == ["none"] and skipped == [UNSHADOWED, f"ember+{UNSHADOWED}"]
    assert select_applicable(every, replace(box, environment=dusk().environment)) == (every, [])


def test_labels_tell_scales_apart(tmp_path: Path) -> None:
    scales = [1 / 3, 0.001, 0.002, 0.0000001, 0.0000002]
    configurations, _ = expand(["gather"], [(64, 48)], scales)
    assert [c.label for c in configurations] == [f"gather at {s}" for s in ("1/3", "0.001", "0.002", "1e-07", "2e-07")]
    assert [c.scale for c in configurations] == scales


def test_a_scale_changes_the_grid_alone() -> None:
    network = find_model("gather")
    assert isinstance(network, Path)
    contract = read_contract(network)
    assert contract.with_scale(0.25) == replace(contract, scale=0.25) and contract.with_scale(None) is contract
    settings = Settings(size=(512, 384), scale=0.25, provider="cpu")
    loaded = load_models([network], settings, has_environment=False).indirect
    assert isinstance(loaded, Network) and loaded.contract == replace(contract, scale=0.25)
    assert loaded.contract.screen_size((512, 384)) == (128, 96)


def test_unknown_models_and_models_of_the_same_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="no model 'gathr'"):
        expand(["gathr"], [(64, 48)])
    network = find_model("gather")
    assert isinstance(network, Path)
    (tmp_path / "gather.onnx").write_bytes(network.read_bytes())
    with pytest.raises(ModelError, match="two models are called 'gather'"):
        expand(["gather", str(tmp_path / "gather.onnx")], [(64, 48)])


def test_a_render_scale_follows_the_name() -> None:
    configurations, absent = expand(["ember", "ember@0.5"], [(1001, 768)])
    assert absent == []
    assert [(c.label, c.render_scale) for c in configurations] == [("ember", 1.0), ("ember@0.5", 0.5)]
    assert configurations[1].settings("cpu").render_size == (501, 384)
    assert configurations[0].models == configurations[1].models


def test_a_render_scale_that_is_too_small_is_an_error() -> None:
    with pytest.raises(SettingsError, match="render_scale"):
        expand(["ember@0.1"], [(64, 48)])
