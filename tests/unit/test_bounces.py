"""Bounces by number: networks that are applied again, and models that are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.errors import SettingsError
from app.network.bounces import ALBEDO, Reapplied, with_bounces
from app.network.channels import HALF_MAX
from app.network.contract import bundled_models, find_model
from app.network.session import Network
from tests.robustness.networks import write_network

SIZE = (9, 7)
COUNTING = "a model that counts bounces, such as ember or radiosity"


@pytest.fixture(scope="module")
def inputs() -> dict[str, np.ndarray]:
    """Direct light, normals and albedo, each random."""
    rng = np.random.default_rng(0)
    shape = (3, SIZE[1], SIZE[0])
    return {"x": np.concatenate([rng.random(shape), np.ones(shape)]).astype(np.float32),
            ALBEDO: rng.uniform(0.5, 0.9, shape).astype(np.float32)}


def times(path: Path, gain: float) -> Network:
    """A network by which as much arrives at each texel as it sends, times ``gain``."""
    return Network(write_network(path / f"{gain}.onnx", ("Mul", ["light", "gain"], "y"), gain=gain), SIZE, "cpu")


@pytest.mark.parametrize("bounces", [2, 3, 8])
@pytest.mark.parametrize("gain", [0.0, 0.3, 1.0])
def test_what_arrived_is_sent_on_by_the_albedo(gain: float, bounces: int, inputs: dict[str, np.ndarray],
                                               tmp_path: Path) -> None:
    """Where light stays in its texel: gain x₀ (1 + gain ρ + … + (gain ρ)ᴺ⁻¹)."""
    light, rho = inputs["x"][:3].astype(np.float64), inputs[ALBEDO].astype(np.float64)
    found = Reapplied(times(tmp_path, gain), bounces).run(inputs)["indirect.rgb"]
    np.testing.assert_allclose(found, gain * light * sum((gain * rho) ** k for k in range(bounces)), rtol=1e-5)


@pytest.mark.parametrize("gain", [3.0, 30.0])
def test_energy_does_not_grow_whatever_the_network(gain: float, inputs: dict[str, np.ndarray], tmp_path: Path) -> None:
    """Bounces after the first bring as much as was sent and no more, so all are below the first's / (1 - ρ)."""
    network = times(tmp_path, gain)
    first = network.run({"x": inputs["x"]})["indirect.rgb"]
    rho = inputs[ALBEDO].astype(np.float64)
    found = Reapplied(network, 8).run(inputs)["indirect.rgb"]
    np.testing.assert_allclose(found, first * sum(rho**k for k in range(8)), rtol=1e-5)
    most = Reapplied(network, 64).run(inputs)["indirect.rgb"]
    assert most.mean() <= first.mean() / (1 - rho.max())


def test_black_stays_black(inputs: dict[str, np.ndarray], tmp_path: Path) -> None:
    network = Reapplied(times(tmp_path, 3.0), 4)
    assert not network.run(inputs | {"x": 0 * inputs["x"]})["indirect.rgb"].any()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, -100.0, 1e30])
@pytest.mark.parametrize("tensor", ["x", ALBEDO])
@pytest.mark.parametrize("share", [0.1, 2.0])
def test_what_is_no_number_leaves_numbers(tensor: str, bad: float, share: float, inputs: dict[str, np.ndarray],
                                          tmp_path: Path) -> None:
    spoiled = np.random.default_rng(1).random(inputs[tensor].shape) < share
    network = Reapplied(times(tmp_path, 0.7), 4)
    found = network.run(inputs | {tensor: np.where(spoiled, np.float32(bad), inputs[tensor])})["indirect.rgb"]
    assert np.isfinite(found).all() and found.min() >= 0 and found.max() <= HALF_MAX
    again, clean = network.run(inputs)["indirect.rgb"], Reapplied(times(tmp_path, 0.7), 4).run(inputs)["indirect.rgb"]
    np.testing.assert_array_equal(again, clean)


def test_the_input_is_left_untouched(inputs: dict[str, np.ndarray], tmp_path: Path) -> None:
    before = {t: x.copy() for t, x in inputs.items()}
    Reapplied(times(tmp_path, 0.7), 4).run(inputs)
    for tensor, x in inputs.items():
        np.testing.assert_array_equal(x, before[tensor])


def test_every_bundled_network_knows_what_to_do() -> None:
    """One that counts is left alone, one of a single bounce on the screen is applied again, others are refused."""
    found = {}
    for name, file in bundled_models().items():
        network = Network(file, SIZE, "cpu")
        if network.contract.shades_environment:
            continue  # it makes no indirect light
        try:
            found[name] = type(with_bounces(network, 3)).__name__
        except SettingsError as error:
            found[name] = error.what
    every = {name: f"{name} gives all bounces at once" for name in (
        "bcnn-8", "bcnn-8-half", "gfa-8", "gfa-8-half", "surround-16", "surround-16-front")}
    assert found == {
        "ember": "Network", "radiosity": "Network", "gather": "gather follows one bounce", **every,
        "bcnn-8-single": "Reapplied", "bcnn-8-single-half": "Reapplied"}


@pytest.mark.parametrize("name", ["gather", "bcnn-8-single"])
def test_one_bounce_is_what_a_network_of_one_bounce_gives(name: str) -> None:
    network = Network(find_model(name), SIZE, "cpu")
    assert with_bounces(network, 1) is network


@pytest.mark.parametrize(("model", "bounces", "said"), [
    ("gather", 2, f"gather follows one bounce, --bounces, expected 1, or {COUNTING}"),
    ("ssgi", 2, f"ssgi follows one bounce, --bounces, expected 1, or {COUNTING}"),
    ("bcnn-8", 3, f"bcnn-8 gives all bounces at once, --bounces, expected none, or {COUNTING}"),
    ("gfa-8", 1, f"gfa-8 gives all bounces at once, --bounces, expected none, or {COUNTING}"),
    ("none", 1, "no model to follow them, --bounces, expected a --model for indirect light"),
])
def test_others_are_refused_in_one_line(model: str, bounces: int, said: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    run = CliRunner().invoke(cli, ["--size", "8x6", "--model", model, "--bounces", str(bounces), "--out", str(out)])
    assert run.exit_code == 2
    assert [line for line in run.stderr.splitlines() if not line.startswith("note:")] == [f"error: {said}"]
    assert not out.exists()
