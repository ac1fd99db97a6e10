from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("lightning_fabric")

from app.errors import ModelError, SettingsError  # noqa: E402
from app.network.contract import ModelContract, TensorSpec  # noqa: E402
from app.scene import PointLight  # noqa: E402
from export.dataset.network_inputs import FrameInputs, PairInputs  # noqa: E402
from export.models import make_network  # noqa: E402
from export.toml_config import read_toml  # noqa: E402
from export.training.augment import augment, permute_colors, scale_lengths, scale_light, subsample  # noqa: E402
from export.training.checkpoint import load_checkpoint  # noqa: E402
from export.training.config import AugmentationConfig, Config, config_from_table, read_config  # noqa: E402
from export.training.examples import (  # noqa: E402
    Examples,
    frame_inputs,
    light_saturation,
    open_examples,
    pairs_up_to_saturation,
    render_missing,
)
from export.training.loop import CHECKPOINT, Run, learning_rate, network_and_loss  # noqa: E402
from tests.training.pairs import CornellPairs, Target  # noqa: E402

ROOT = Path(__file__).parents[2]
H, W = 24, 32
CONTRACT = make_network("bcnn-8").contract
FORWARD = np.array([0, 0, 1], np.float32).reshape(3, 1, 1)


def config(folder: Path, **schedule: Any) -> Config:
    return config_from_table({
        "network": {"preset": "bcnn-8"}, "data": {"dataset": str(folder), "validation": 0.2},
        "schedule": {"epochs": 3, "batch": 4, "learning_rate": 2e-3, **schedule},
        "device": {"accelerator": "cpu"}, "report": {"log_steps": 2, "checkpoint_steps": 2}}, "test")


def examples(folder: Path, count: int = 10, contract: ModelContract = CONTRACT) -> Examples:
    """Synthetic inputs: a wall with random direct light, and half of it as indirect light."""
    pairs = CornellPairs(folder, count)
    data = Examples(pairs, contract)
    for index in range(count):
        rng = np.random.default_rng(index)
        blocks = np.repeat(np.repeat(rng.random((3, H // 8, W // 8), np.float32), 8, axis=1), 8, axis=2)
        flat = np.ones((3, H, W), np.float32)
        known = {"direct.rgb": blocks, "albedo.rgb": flat, "normal.view.xyz": flat * FORWARD,
                 "position.view.xyz": -20.0 * flat * FORWARD, "depth": 20.0 * flat[:1]}
        frame = FrameInputs({t: np.concatenate([known[name] for name in spec.channels])
                       for t, spec in contract.inputs.items()}, 2.0)
        light = np.moveaxis(blocks, 0, -1)
        ones = np.ones((H, W), bool)
        target = Target({"indirect": light, "indirect_single": light / 2}, ones)
        data.store(index, PairInputs(frame, frame, np.zeros((2, H, W), np.float32), ones), target)
    return data


def losses(folder: Path) -> list[tuple[int, Any]]:
    lines = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    return [(line["step"], line.get("loss", line.get("validation"))) for line in lines]


def test_stored_examples_are_read_back(tmp_path: Path) -> None:
    stored = examples(tmp_path, 2)
    again = Examples(CornellPairs(tmp_path, 2), CONTRACT)
    batch = again.batch([1])
    assert again.missing == []
    light = frame_inputs(batch, "current")["x"][0, :3]
    torch.testing.assert_close(batch["target"][0], light / 2, rtol=1e-3, atol=1e-3)  # exposure is 2
    assert batch["exposure_ratio"].item() == 1.0 and batch["surface_mask"].min() == 1.0
    assert torch.equal(batch["current.x"], stored.batch([1])["current.x"])


def test_single_bounce_networks_get_single_bounce_targets(tmp_path: Path) -> None:
    pairs = CornellPairs(tmp_path, 1)
    multi, single = (Examples(pairs, replace(CONTRACT, bounces=bounces)) for bounces in ("multi", "single"))
    frame = FrameInputs({"x": np.zeros((9, H, W), np.float32)}, 1.0)
    multi.store(0, PairInputs(frame, frame, np.zeros((2, H, W), np.float32), np.ones((H, W), bool)), pairs.target(0))
    assert single.missing == [], "both share the rendered inputs"
    torch.testing.assert_close(single.batch([0])["target"], 0.5 * multi.batch([0])["target"], rtol=1e-2, atol=1e-4)


@pytest.mark.gl
def test_missing_examples_are_rendered_once(tmp_path: Path) -> None:
    pairs = CornellPairs(tmp_path, 3)
    first = Examples(pairs, CONTRACT)
    assert first.missing == [0, 1, 2]
    assert sum(render_missing(pairs, CONTRACT, workers=1)) == 3
    rendered = Examples(pairs, CONTRACT)
    assert rendered.missing == [] and sum(render_missing(pairs, CONTRACT, workers=1)) == 0
    assert rendered.batch([0])["current.x"][:, :3].mean() > 0.3


@pytest.mark.gl
def test_previous_frames_are_rendered_only_if_required(tmp_path: Path) -> None:
    pairs = CornellPairs(tmp_path, 2)
    assert sum(render_missing(pairs, CONTRACT, previous=False, workers=1)) == 2
    current = Examples(pairs, CONTRACT, previous=False).batch([0, 1])
    assert set(current) == {"current.x", "target", "surface_mask"}
    assert len(Examples(pairs, CONTRACT).missing) == 2
    assert not open_examples(pairs, CONTRACT, previous=False).missing, "incomplete ones are not used"
    assert sum(render_missing(pairs, CONTRACT, workers=1)) == 2
    both = open_examples(pairs, CONTRACT, previous=False)
    assert both.missing == [] and "previous.x" in both.batch([0]), "complete examples with previous frames are reused"
    for name, x in current.items():
        assert torch.equal(x, both.batch([0, 1])[name])
    random = torch.Generator().manual_seed(0)
    assert set(augment(subsample(current, CONTRACT, 2), CONTRACT, AugmentationConfig(), random)) == set(current)


def test_augmentation_changes_the_right_channels(tmp_path: Path) -> None:
    batch = examples(tmp_path, 2).batch([0, 1])
    order = torch.tensor([[1, 2, 0], [0, 1, 2]])
    permuted = permute_colors(batch, CONTRACT, order)
    assert torch.equal(permuted["current.x"][0, :3], batch["current.x"][0, [1, 2, 0]])
    assert torch.equal(permuted["target"][0], batch["target"][0, [1, 2, 0]])
    assert torch.equal(permuted["current.x"][0, 3:], batch["current.x"][0, 3:])
    assert torch.equal(permuted["target"][1], batch["target"][1])
    larger = scale_lengths(batch, CONTRACT, torch.tensor([2.0, 0.5]))
    assert torch.equal(larger["current.x"][:, :6], batch["current.x"][:, :6])
    assert torch.equal(larger["previous.x"][1, 6:], 0.5 * batch["previous.x"][1, 6:])
    assert torch.equal(larger["target"], batch["target"])
    bright = scale_light(batch, CONTRACT, torch.tensor([4.0, 0.5]))
    assert torch.equal(bright["previous.x"][0, :3], 4 * batch["previous.x"][0, :3])
    assert torch.equal(bright["target"][1], 0.5 * batch["target"][1])
    assert torch.equal(bright["current.x"][:, 3:], batch["current.x"][:, 3:])


def test_subsampling_keeps_every_second_texel(tmp_path: Path) -> None:
    batch = examples(tmp_path, 2).batch([0, 1])
    batch["motion"] += 3.0
    coarse = subsample(batch, CONTRACT, 2)
    for name in ("current.x", "previous.x", "target", "surface_mask", "history_mask"):
        assert torch.equal(coarse[name], batch[name][:, :, ::2, ::2])
    assert torch.equal(coarse["motion"], batch["motion"][:, :, ::2, ::2] / 2), "motion is in texels of the grid"
    assert torch.equal(coarse["exposure_ratio"], batch["exposure_ratio"])


def test_subsampling_leaves_cubes_and_globals_unchanged() -> None:
    inputs = {"x": TensorSpec(("direct.rgb",)), "cube": TensorSpec(("direct.rgb",), "cube", size=4),
              "sky": TensorSpec(("environment.sh",), "globals")}
    contract = replace(CONTRACT, inputs=inputs, cube_axes="camera")
    shapes = {"x": (1, 3, 8, 8), "cube": (1, 3, 6, 4, 4), "sky": (1, 75)}
    batch = {f"{frame}.{t}": torch.rand(shape) for frame in ("current", "previous") for t, shape in shapes.items()}
    coarse = subsample({**batch, "target": torch.rand(1, 3, 8, 8), "motion": torch.zeros(1, 2, 8, 8)}, contract, 4)
    assert coarse["current.x"].shape[-2:] == coarse["target"].shape[-2:] == (2, 2)
    assert torch.equal(coarse["current.cube"], batch["current.cube"])
    assert torch.equal(coarse["previous.sky"], batch["previous.sky"])


def test_a_stride_that_does_not_fit_the_grid_is_refused(tmp_path: Path) -> None:
    table = config(tmp_path).to_json()
    table["data"]["texel_stride"] = 5
    with pytest.raises(SettingsError, match=r"a grid of 32x24 does not fit data.texel_stride = 5.*multiples of"):
        Run(config_from_table(table, "test"), examples(tmp_path), tmp_path / "run")


def test_loss_decreases_on_a_few_examples(tmp_path: Path) -> None:
    run = Run(config(tmp_path, epochs=2, learning_rate=5e-3, ema=0.9), examples(tmp_path, 130), tmp_path / "run")
    before = run.validate()["loss"]
    assert run.train()["loss"] < 0.6 * before
    assert (tmp_path / "run" / "curve.png").stat().st_size > 1000
    assert (tmp_path / "run" / "pictures" / "0002.png").exists()
    assert load_checkpoint(tmp_path / "run" / CHECKPOINT).facts["weights"] == 62691


def test_pairs_are_held_out_and_limited(tmp_path: Path) -> None:
    data = examples(tmp_path)
    table = config(tmp_path).to_json()
    run = Run(config(tmp_path), data, tmp_path / "all")
    assert (run.trained_on, run.held_out) == (list(range(8)), [8, 9])
    table["data"]["pairs"] = 4
    run = Run(config_from_table(table, "test"), data, tmp_path / "half")
    assert (run.trained_on, run.held_out) == ([0, 1, 2, 3], [8, 9])
    table["data"]["pairs"] = 9
    with pytest.raises(SettingsError, match="at most 8"):
        Run(config_from_table(table, "test"), data, tmp_path / "more")


def test_pairs_with_saturated_lights_can_be_left_out(tmp_path: Path) -> None:
    data = examples(tmp_path)
    pairs = CornellPairs(tmp_path, 10)
    white = replace(pairs.scene, materials=(), lights=(PointLight((0.0, 0.0, 0.0), (1.0, 0.9, 0.8)),))
    assert light_saturation(white) == pytest.approx(0.2)
    emissive = replace(pairs.scene.materials[0], emission=(0.0, 0.5, 1.0))
    assert light_saturation(replace(white, materials=(emissive,))) == 1.0
    assert light_saturation(replace(white, lights=())) == 0.0
    assert pairs_up_to_saturation(pairs, 1.0) is None
    assert pairs_up_to_saturation(pairs, light_saturation(pairs.scene)) == list(range(10))
    assert pairs_up_to_saturation(pairs, light_saturation(pairs.scene) / 2) == []
    run = Run(config(tmp_path), data, tmp_path / "some", [1, 2, 5, 7, 9])
    assert (run.trained_on, run.held_out) == ([1, 2, 5, 7], [8, 9])
    run.train()
    with pytest.raises(SettingsError, match="at most 3 of 10"):
        Run(config_from_table({**config(tmp_path).to_json(), "data": {"dataset": "d", "pairs": 4}}, "test"), data,
            tmp_path / "few", [1, 2, 5])


def test_gradients_are_limited(tmp_path: Path) -> None:
    """Adam normalizes gradients unless they are as small as its ε; then the weights hardly change."""
    data, moves = examples(tmp_path), []
    for limit in (None, 1e-12):
        run = Run(config(tmp_path, epochs=2, ema=0.0, max_gradient_norm=limit), data, tmp_path / f"{limit}")
        before = [p.detach().clone() for p in run._module.parameters()]
        run.train()
        moves.append(max(float((p.detach() - b).abs().max())
                         for p, b in zip(run._module.parameters(), before, strict=True)))
    assert moves[0] > 1e-3 and moves[1] < 1e-6


def test_the_seed_decides_the_run(tmp_path: Path) -> None:
    data = examples(tmp_path)
    for name in ("one", "two"):
        Run(config(tmp_path), data, tmp_path / name).train()
    assert losses(tmp_path / "one") == losses(tmp_path / "two")
    other = config(tmp_path).to_json() | {"seed": 1}
    Run(config_from_table(other, "test"), data, tmp_path / "other").train()
    assert losses(tmp_path / "other") != losses(tmp_path / "one")


def test_a_killed_run_resumes_to_the_same_curve(tmp_path: Path) -> None:
    """Killed at some step after its first checkpoint; the resumed curve is bit-identical."""
    data = examples(tmp_path)
    Run(config(tmp_path, epochs=4), data, tmp_path / "whole").train()
    script = (f"from pathlib import Path; from tests.training.test_training import *; f = Path({str(tmp_path)!r});"
              "Run(config(f, epochs=4), Examples(CornellPairs(f, 10), CONTRACT), f / 'killed').train("
              "lambda step, steps, terms: time.sleep(0.1))")
    # Sums depend on the number of threads, and Dask leaves such variables behind.
    threads = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS"), str(torch.get_num_threads()))
    environment = {**os.environ, **threads, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen([sys.executable, "-c", script], cwd=ROOT, env=environment)
    checkpoint = tmp_path / "killed" / CHECKPOINT
    deadline = time.monotonic() + 300
    while not checkpoint.exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    resumed = Run(config(tmp_path, epochs=4), data, tmp_path / "killed")
    assert 0 < resumed.progress.step < resumed.steps
    resumed.train()
    assert losses(tmp_path / "killed") == losses(tmp_path / "whole")
    last = [load_checkpoint(tmp_path / name / CHECKPOINT) for name in ("whole", "killed")]
    assert all(torch.equal(last[0].ema[key], last[1].ema[key]) for key in last[0].ema)


def test_learning_rate_follows_a_cosine() -> None:
    schedule = config(Path(), learning_rate=1e-3, final_learning_rate=1e-5).schedule
    assert [learning_rate(schedule, s) for s in (0.0, 0.5, 1.0)] == pytest.approx([1e-3, 5.05e-4, 1e-5])


def test_a_checkpoint_of_another_configuration_is_refused(tmp_path: Path) -> None:
    data = examples(tmp_path)
    Run(config(tmp_path, epochs=1), data, tmp_path / "run").train()
    with pytest.raises(SettingsError, match="configuration differs"):
        Run(config(tmp_path, epochs=2), data, tmp_path / "run")


@pytest.mark.parametrize(("text", "message"), [
    ("[network]\npreset = 'bcnn-8'\n", "data"),
    ("[network]\npreset = 'bcnn-8'\nwidth = 3\n[data]\ndataset = 'x'\n[schedule]\nepochs = 1\n", "network.width"),
    ("[network]\npreset = 'bcnn-8'\n[data]\ndataset = 'x'\n[schedule]\nepochs = 0\n", "schedule.epochs"),
    ("nonsense", "can't read"),
])
def test_bad_configurations_are_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=message) as error:
        read_config(path)
    assert "\n" not in str(error.value)


CONFIGS = sorted((ROOT / "export" / "training" / "configs").rglob("*.toml"))
VARIANTS = [(path, variant) for path in CONFIGS for variant in (None, *read_toml(path).get("variants", {}))]


@pytest.mark.parametrize(("path", "variant"), VARIANTS, ids=[f"{path.stem}-{variant}" for path, variant in VARIANTS])
def test_every_configuration_and_variant_is_valid(path: Path, variant: str | None) -> None:
    config = read_config(path, variant=variant)
    if config.network.preset.endswith("-paper"):  # the same class, but slow to initialise
        config = replace(config, network=replace(config.network, preset=config.network.preset.replace("paper", "16")))
    network, _ = network_and_loss(config)
    assert network.contract.bounces in ("single", "multi") and config.data.texel_stride in (1, 2)
    assert variant is None or config != read_config(path)


BASE = """
[network]
preset = "gfa-8"
options = { heads = 4, layers = 1 }
[data]
dataset = "a"
[schedule]
epochs = 2
[variants.fewer]
network.options.heads = 0
schedule = { epochs = 3, batch = 2 }
"""


def test_a_variant_overrides_single_keys(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(BASE)
    base, fewer = read_config(path), read_config(path, tmp_path, "fewer")
    assert (base.network.options, base.schedule.epochs, base.schedule.batch) == ({"heads": 4, "layers": 1}, 2, 8)
    assert fewer.network.options == {"heads": 0, "layers": 1}
    assert (fewer.schedule.epochs, fewer.schedule.batch, fewer.data.dataset) == (3, 2, tmp_path)


@pytest.mark.parametrize(("text", "message"), [
    (BASE, r"config.toml: no variant 'more' \(expected one of: fewer\)"),
    (BASE.partition("[variants")[0], r"config.toml: no variant 'more' \(expected none, since .*\)"),
    (BASE + "[variants.more]\nwidth = 3\n", r"config.toml: bad key 'width'"),
    (BASE.partition("[variants")[0] + "[variants]\nmore = 3\n", r"config.toml: bad key 'variants'"),
])
def test_bad_variants_are_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=message) as error:
        read_config(path, variant="more")
    assert "\n" not in str(error.value)


def test_a_damaged_checkpoint_is_one_line(tmp_path: Path) -> None:
    (tmp_path / CHECKPOINT).write_bytes(b"PK\x03\x04 nothing")
    with pytest.raises(ModelError, match="not a checkpoint"):
        load_checkpoint(tmp_path / CHECKPOINT)
    with pytest.raises(ModelError, match="can't read"):
        load_checkpoint(tmp_path / "missing.pt")


def test_a_checkpoint_of_another_version_is_named(tmp_path: Path) -> None:
    torch.save({"version": 3}, tmp_path / CHECKPOINT)
    with pytest.raises(ModelError, match=rf"{CHECKPOINT}: made by another version \(3\) \(expected 4; make it again"):
        load_checkpoint(tmp_path / CHECKPOINT)
