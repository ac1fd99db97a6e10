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
from export.dataset.network_inputs import Frame, Inputs  # noqa: E402
from export.models import make_network  # noqa: E402
from export.training.augment import augment, coarser, exposed, permuted, sized  # noqa: E402
from export.training.checkpoint import load  # noqa: E402
from export.training.config import AugmentationConfig, Config, from_table, read_config  # noqa: E402
from export.training.eligible import eligible, saturation  # noqa: E402
from export.training.examples import Examples, tensors_of  # noqa: E402
from export.training.loop import CHECKPOINT, Run, learning_rate  # noqa: E402
from tests.training.pairs import CornellPairs, Target  # noqa: E402

ROOT = Path(__file__).parents[2]
H, W = 24, 32
CONTRACT = make_network("bcnn-8").contract
FORWARD = np.array([0, 0, 1], np.float32).reshape(3, 1, 1)


def config(folder: Path, **schedule: Any) -> Config:
    return from_table({
        "network": {"preset": "bcnn-8"}, "data": {"dataset": str(folder), "validation": 0.2},
        "schedule": {"epochs": 3, "batch": 4, "learning_rate": 2e-3, **schedule},
        "device": {"accelerator": "cpu"}, "report": {"log_steps": 2, "checkpoint_steps": 2}}, "test")


def examples(folder: Path, count: int = 10, contract: ModelContract = CONTRACT) -> Examples:
    """Made-up inputs: a room of random light whose indirect light is a blurred half of it."""
    pairs = CornellPairs(folder, count)
    made = Examples(pairs, contract)
    for index in range(count):
        rng = np.random.default_rng(index)
        blocks = np.repeat(np.repeat(rng.random((3, H // 8, W // 8), np.float32), 8, axis=1), 8, axis=2)
        flat = np.ones((3, H, W), np.float32)
        known = {"direct.rgb": blocks, "albedo.rgb": flat, "normal.view.xyz": flat * FORWARD,
                 "position.view.xyz": -20.0 * flat * FORWARD, "depth": 20.0 * flat[:1]}
        frame = Frame({t: np.concatenate([known[name] for name in spec.channels])
                       for t, spec in contract.inputs.items()}, 2.0)
        light = np.moveaxis(blocks, 0, -1)
        ones = np.ones((H, W), bool)
        target = Target({"indirect": light, "indirect_single": light / 2}, ones)
        made.put(index, Inputs(frame, frame, np.zeros((2, H, W), np.float32), ones), target)
    return made


def losses(folder: Path) -> list[tuple[int, Any]]:
    lines = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    return [(line["step"], line.get("loss", line.get("validation"))) for line in lines]


def test_examples_come_back_as_they_were_put(tmp_path: Path) -> None:
    kept = examples(tmp_path, 2)
    again = Examples(CornellPairs(tmp_path, 2), CONTRACT)
    batch = again.batch([1])
    assert again.missing == []
    light = tensors_of(batch, "current")["x"][0, :3]
    torch.testing.assert_close(batch["target"][0], light / 2, rtol=1e-3, atol=1e-3)  # exposure is 2
    assert batch["ratio"].item() == 1.0 and batch["seen"].min() == 1.0
    assert torch.equal(batch["current.x"], kept.batch([1])["current.x"])


def test_single_bounce_networks_get_single_bounce_targets(tmp_path: Path) -> None:
    from dataclasses import replace

    pairs = CornellPairs(tmp_path, 1)
    multi, single = (Examples(pairs, replace(CONTRACT, bounces=bounces)) for bounces in ("multi", "single"))
    frame = Frame({"x": np.zeros((9, H, W), np.float32)}, 1.0)
    multi.put(0, Inputs(frame, frame, np.zeros((2, H, W), np.float32), np.ones((H, W), bool)), pairs.target(0))
    assert single.missing == [], "what is drawn serves both"
    torch.testing.assert_close(single.batch([0])["target"], 0.5 * multi.batch([0])["target"], rtol=1e-2, atol=1e-4)


@pytest.mark.gl
def test_missing_examples_are_drawn_once(tmp_path: Path) -> None:
    from export.training.examples import draw_missing

    pairs = CornellPairs(tmp_path, 3)
    first = Examples(pairs, CONTRACT)
    assert first.missing == [0, 1, 2]
    assert sum(draw_missing(pairs, CONTRACT, workers=1)) == 3
    drawn = Examples(pairs, CONTRACT)
    assert drawn.missing == [] and sum(draw_missing(pairs, CONTRACT, workers=1)) == 0
    assert drawn.batch([0])["current.x"][:, :3].mean() > 0.3


@pytest.mark.gl
def test_frames_before_are_drawn_only_where_they_are_wanted(tmp_path: Path) -> None:
    from export.training.examples import draw_missing, examples_for

    pairs = CornellPairs(tmp_path, 2)
    assert sum(draw_missing(pairs, CONTRACT, previous=False, workers=1)) == 2
    alone = Examples(pairs, CONTRACT, previous=False).batch([0, 1])
    assert set(alone) == {"current.x", "target", "seen"}
    assert len(Examples(pairs, CONTRACT).missing) == 2
    assert not examples_for(pairs, CONTRACT, previous=False).missing, "an empty folder of both hides nothing"
    assert sum(draw_missing(pairs, CONTRACT, workers=1)) == 2
    both = examples_for(pairs, CONTRACT, previous=False)
    assert both.missing == [] and "previous.x" in both.batch([0]), "what is kept already serves"
    for name, x in alone.items():
        assert torch.equal(x, both.batch([0, 1])[name])
    random = torch.Generator().manual_seed(0)
    assert set(augment(coarser(alone, CONTRACT, 2), CONTRACT, AugmentationConfig(), random)) == set(alone)


def test_augmented_colours_stay_with_their_channels(tmp_path: Path) -> None:
    batch = examples(tmp_path, 2).batch([0, 1])
    order = torch.tensor([[1, 2, 0], [0, 1, 2]])
    found = permuted(batch, CONTRACT, order)
    assert torch.equal(found["current.x"][0, :3], batch["current.x"][0, [1, 2, 0]])
    assert torch.equal(found["target"][0], batch["target"][0, [1, 2, 0]])
    assert torch.equal(found["current.x"][0, 3:], batch["current.x"][0, 3:])
    assert torch.equal(found["target"][1], batch["target"][1])
    larger = sized(batch, CONTRACT, torch.tensor([2.0, 0.5]))
    assert torch.equal(larger["current.x"][:, :6], batch["current.x"][:, :6])
    assert torch.equal(larger["previous.x"][1, 6:], 0.5 * batch["previous.x"][1, 6:])
    assert torch.equal(larger["target"], batch["target"])
    bright = exposed(batch, CONTRACT, torch.tensor([4.0, 0.5]))
    assert torch.equal(bright["previous.x"][0, :3], 4 * batch["previous.x"][0, :3])
    assert torch.equal(bright["target"][1], 0.5 * batch["target"][1])
    assert torch.equal(bright["current.x"][:, 3:], batch["current.x"][:, 3:])


def test_every_second_texel_is_a_coarser_grid_of_the_same_view(tmp_path: Path) -> None:
    batch = examples(tmp_path, 2).batch([0, 1])
    batch["motion"] += 3.0
    found = coarser(batch, CONTRACT, 2)
    for name in ("current.x", "previous.x", "target", "seen", "visible"):
        assert torch.equal(found[name], batch[name][:, :, ::2, ::2])
    assert torch.equal(found["motion"], batch["motion"][:, :, ::2, ::2] / 2), "motion is in texels of the grid"
    assert torch.equal(found["ratio"], batch["ratio"])


def test_points_and_numbers_of_the_frame_are_not_picked_from() -> None:
    inputs = {"x": TensorSpec(("direct.rgb",)), "cube": TensorSpec(("direct.rgb",), "cube", size=4),
              "sky": TensorSpec(("environment.sh",), "globals")}
    contract = replace(CONTRACT, inputs=inputs, cube_axes="camera")
    shapes = {"x": (1, 3, 8, 8), "cube": (1, 3, 6, 4, 4), "sky": (1, 75)}
    batch = {f"{frame}.{t}": torch.rand(shape) for frame in ("current", "previous") for t, shape in shapes.items()}
    found = coarser({**batch, "target": torch.rand(1, 3, 8, 8), "motion": torch.zeros(1, 2, 8, 8)}, contract, 4)
    assert found["current.x"].shape[-2:] == found["target"].shape[-2:] == (2, 2)
    assert torch.equal(found["current.cube"], batch["current.cube"])
    assert torch.equal(found["previous.sky"], batch["previous.sky"])


def test_a_grid_that_can_not_be_that_coarse_is_refused(tmp_path: Path) -> None:
    table = config(tmp_path).to_json()
    table["data"]["every"] = 5
    with pytest.raises(SettingsError, match=r"data.every = 5 on a grid of 32x24.*multiples of"):
        Run(from_table(table, "test"), examples(tmp_path), tmp_path / "run")


def test_loss_falls_on_a_few_examples(tmp_path: Path) -> None:
    run = Run(config(tmp_path, epochs=2, learning_rate=5e-3, ema=0.9), examples(tmp_path, 130), tmp_path / "run")
    before = run.validate()["loss"]
    assert run.train()["loss"] < 0.6 * before
    assert (tmp_path / "run" / "curve.png").stat().st_size > 1000
    assert (tmp_path / "run" / "pictures" / "0002.png").exists()
    assert load(tmp_path / "run" / CHECKPOINT).facts["weights"] == 62691


def test_a_part_of_the_pairs_is_held_out_and_a_part_is_enough(tmp_path: Path) -> None:
    made = examples(tmp_path)
    table = config(tmp_path).to_json()
    run = Run(config(tmp_path), made, tmp_path / "all")
    assert (run.trained_on, run.held_out) == (list(range(8)), [8, 9])
    table["data"]["pairs"] = 4
    run = Run(from_table(table, "test"), made, tmp_path / "half")
    assert (run.trained_on, run.held_out) == ([0, 1, 2, 3], [8, 9])
    table["data"]["pairs"] = 9
    with pytest.raises(SettingsError, match="at most 8"):
        Run(from_table(table, "test"), made, tmp_path / "more")


def test_pairs_with_saturated_lights_can_be_left_out(tmp_path: Path) -> None:
    made = examples(tmp_path)
    pairs = CornellPairs(tmp_path, 10)
    white = replace(pairs.scene, materials=(), lights=(PointLight((0.0, 0.0, 0.0), (1.0, 0.9, 0.8)),))
    assert saturation(white) == pytest.approx(0.2)
    glow = replace(pairs.scene.materials[0], emission=(0.0, 0.5, 1.0))
    assert saturation(replace(white, materials=(glow,))) == 1.0
    assert saturation(replace(white, lights=())) == 0.0
    assert eligible(pairs, 1.0) is None
    assert eligible(pairs, saturation(pairs.scene)) == list(range(10))
    assert eligible(pairs, saturation(pairs.scene) / 2) == []
    run = Run(config(tmp_path), made, tmp_path / "some", [1, 2, 5, 7, 9])
    assert (run.trained_on, run.held_out) == ([1, 2, 5, 7], [8, 9])
    run.train()
    with pytest.raises(SettingsError, match="at most 3 of 10"):
        Run(from_table({**config(tmp_path).to_json(), "data": {"dataset": "d", "pairs": 4}}, "test"), made,
            tmp_path / "few", [1, 2, 5])


def test_gradients_are_limited(tmp_path: Path) -> None:
    """Adam divides a gradient by its own size, but for one as small as its ε: then hardly anything is learned."""
    made, found = examples(tmp_path), []
    for limit in (None, 1e-12):
        run = Run(config(tmp_path, epochs=2, ema=0.0, largest_gradient=limit), made, tmp_path / f"{limit}")
        before = [p.detach().clone() for p in run._bare.parameters()]
        run.train()
        moves = [(p.detach() - b).abs().max() for p, b in zip(run._bare.parameters(), before, strict=True)]
        found.append(float(torch.stack(moves).max()))
    assert found[0] > 1e-3 and found[1] < 1e-6


def test_the_seed_decides_the_run(tmp_path: Path) -> None:
    made = examples(tmp_path)
    for name in ("one", "two"):
        Run(config(tmp_path), made, tmp_path / name).train()
    assert losses(tmp_path / "one") == losses(tmp_path / "two")
    other = config(tmp_path).to_json() | {"seed": 1}
    Run(from_table(other, "test"), made, tmp_path / "other").train()
    assert losses(tmp_path / "other") != losses(tmp_path / "one")


def test_a_killed_run_resumes_to_the_same_curve(tmp_path: Path) -> None:
    """Killed as by a cluster, somewhere after its first checkpoint; the curve is the same to the last bit."""
    made = examples(tmp_path)
    Run(config(tmp_path, epochs=4), made, tmp_path / "whole").train()
    script = (f"from pathlib import Path; from tests.training.test_training import *; f = Path({str(tmp_path)!r});"
              "Run(config(f, epochs=4), Examples(CornellPairs(f, 10), CONTRACT), f / 'killed').train("
              "lambda step, steps, terms: time.sleep(0.1))")
    # Other numbers of threads give other sums, and Dask leaves such variables behind.
    threads = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS"), str(torch.get_num_threads()))
    environment = {**os.environ, **threads, "PYTHONPATH": str(ROOT)}
    process = subprocess.Popen([sys.executable, "-c", script], cwd=ROOT, env=environment)
    checkpoint = tmp_path / "killed" / CHECKPOINT
    deadline = time.monotonic() + 300
    while not checkpoint.exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    resumed = Run(config(tmp_path, epochs=4), made, tmp_path / "killed")
    assert 0 < resumed.progress.step < resumed.steps
    resumed.train()
    assert losses(tmp_path / "killed") == losses(tmp_path / "whole")
    last = [load(tmp_path / name / CHECKPOINT) for name in ("whole", "killed")]
    assert all(torch.equal(last[0].ema[key], last[1].ema[key]) for key in last[0].ema)


def test_learning_rate_falls_by_a_cosine() -> None:
    schedule = config(Path(), learning_rate=1e-3, final_learning_rate=1e-5).schedule
    assert [learning_rate(schedule, s) for s in (0.0, 0.5, 1.0)] == pytest.approx([1e-3, 5.05e-4, 1e-5])


def test_another_configuration_does_not_go_on_with_a_checkpoint(tmp_path: Path) -> None:
    made = examples(tmp_path)
    Run(config(tmp_path, epochs=1), made, tmp_path / "run").train()
    with pytest.raises(SettingsError, match="another configuration"):
        Run(config(tmp_path, epochs=2), made, tmp_path / "run")


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


@pytest.mark.parametrize("path", sorted((ROOT / "export" / "configs").rglob("*.toml")), ids=lambda path: path.stem)
def test_shipped_configurations_fit(path: Path) -> None:
    chosen = read_config(path)
    assert make_network(chosen.network.preset, chosen.network.options).contract.bounces in ("single", "multi")


def test_a_damaged_checkpoint_is_one_line(tmp_path: Path) -> None:
    (tmp_path / CHECKPOINT).write_bytes(b"PK\x03\x04 nothing")
    with pytest.raises(ModelError, match="no checkpoint"):
        load(tmp_path / CHECKPOINT)
    with pytest.raises(ModelError, match="can't read"):
        load(tmp_path / "missing.pt")


@pytest.mark.parametrize("file", sorted((ROOT / "export" / "configs").rglob("*.toml")), ids=lambda f: f.stem)
def test_every_configuration_makes_a_network_and_its_loss(file: Path) -> None:
    from export.training.loop import network_and_loss

    config = read_config(file)
    if config.network.preset.endswith("-paper"):
        config = replace(config, network=replace(config.network, preset=config.network.preset.replace("paper", "16")))
    network, _ = network_and_loss(config)
    assert config.data.every in (1, 2) and network.contract.name
