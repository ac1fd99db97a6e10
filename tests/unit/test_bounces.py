"""Numbers of bounces: networks that are applied repeatedly, and models that are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from app.cli import cli
from app.errors import SettingsError
from app.network.bounces import ALBEDO, RepeatedNetwork, with_bounces
from app.network.channels import HALF_MAX
from app.network.selection import bundled_models, find_model
from app.network.session import Network
from tests.robustness.networks import write_network

SIZE = (9, 7)
ADVICE = "or a model that takes a number of bounces, such as ember or radiosity"


@pytest.fixture(scope="module")
def inputs() -> dict[str, np.ndarray]:
    """Direct light, normals and albedo, each random."""
    rng = np.random.default_rng(0)
    shape = (3, SIZE[1], SIZE[0])
    return {"x": np.concatenate([rng.random(shape), np.ones(shape)]).astype(np.float32),
            ALBEDO: rng.uniform(0.5, 0.9, shape).astype(np.float32)}


def times(path: Path, gain: float) -> Network:
    """A network that gives each texel the light that it sends out, times ``gain``."""
    return Network(write_network(path / f"{gain}.onnx", ("Mul", ["light", "gain"], "y"), gain=gain), SIZE, "cpu")


@pytest.mark.parametrize("bounces", [2, 3, 8])
@pytest.mark.parametrize("gain", [0.0, 0.3, 1.0])
def test_arriving_light_is_reflected_by_the_albedo(gain: float, bounces: int, inputs: dict[str, np.ndarray],
                                               tmp_path: Path) -> None:
    """For light that stays in its texel: gain x₀ (1 + gain ρ + … + (gain ρ)ᴺ⁻¹)."""
    light, rho = inputs["x"][:3].astype(np.float64), inputs[ALBEDO].astype(np.float64)
    indirect = RepeatedNetwork(times(tmp_path, gain), bounces).run(inputs)["indirect.rgb"]
    np.testing.assert_allclose(indirect, gain * light * sum((gain * rho) ** k for k in range(bounces)), rtol=1e-5)


@pytest.mark.parametrize("gain", [3.0, 30.0])
def test_energy_does_not_grow_whatever_the_network(gain: float, inputs: dict[str, np.ndarray], tmp_path: Path) -> None:
    """Bounces after the first add exactly what was sent out, so the sum stays below the first bounce / (1 - ρ)."""
    network = times(tmp_path, gain)
    first = network.run({"x": inputs["x"]})["indirect.rgb"]
    rho = inputs[ALBEDO].astype(np.float64)
    indirect = RepeatedNetwork(network, 8).run(inputs)["indirect.rgb"]
    np.testing.assert_allclose(indirect, first * sum(rho**k for k in range(8)), rtol=1e-5)
    total = RepeatedNetwork(network, 64).run(inputs)["indirect.rgb"]
    assert total.mean() <= first.mean() / (1 - rho.max())


def test_black_stays_black(inputs: dict[str, np.ndarray], tmp_path: Path) -> None:
    network = RepeatedNetwork(times(tmp_path, 3.0), 4)
    assert not network.run(inputs | {"x": 0 * inputs["x"]})["indirect.rgb"].any()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, -100.0, 1e30])
@pytest.mark.parametrize("tensor", ["x", ALBEDO])
@pytest.mark.parametrize("share", [0.1, 2.0])
def test_non_finite_inputs_give_finite_outputs(tensor: str, bad: float, share: float, inputs: dict[str, np.ndarray],
                                          tmp_path: Path) -> None:
    replaced = np.random.default_rng(1).random(inputs[tensor].shape) < share
    network = RepeatedNetwork(times(tmp_path, 0.7), 4)
    indirect = network.run(inputs | {tensor: np.where(replaced, np.float32(bad), inputs[tensor])})["indirect.rgb"]
    assert np.isfinite(indirect).all() and indirect.min() >= 0 and indirect.max() <= HALF_MAX
    again = network.run(inputs)["indirect.rgb"]
    clean = RepeatedNetwork(times(tmp_path, 0.7), 4).run(inputs)["indirect.rgb"]
    np.testing.assert_array_equal(again, clean)


def test_the_input_is_left_untouched(inputs: dict[str, np.ndarray], tmp_path: Path) -> None:
    before = {t: x.copy() for t, x in inputs.items()}
    RepeatedNetwork(times(tmp_path, 0.7), 4).run(inputs)
    for tensor, x in inputs.items():
        np.testing.assert_array_equal(x, before[tensor])


def test_bundled_networks_are_kept_repeated_or_refused() -> None:
    """Networks that take a number are kept, single-bounce ones on the screen are repeated, others are refused."""
    outcomes = {}
    for name, file in bundled_models().items():
        network = Network(file, SIZE, "cpu")
        if network.contract.shades_environment:
            continue  # it makes no indirect light
        try:
            outcomes[name] = type(with_bounces(network, 3)).__name__
        except SettingsError as error:
            outcomes[name] = error.what
    every = {name: f"{name} always computes all bounces" for name in (
        "bcnn-8", "bcnn-8-half", "bcnn-gather", "final-gather", "gfa-8", "gfa-8-half", "gfa-gather", "surround-16")}
    assert outcomes == {
        "ember": "Network", "radiosity": "Network", "gather": "gather computes a single bounce", **every,
        "bcnn-8-single": "RepeatedNetwork", "bcnn-8-single-half": "RepeatedNetwork"}


@pytest.mark.parametrize("name", ["gather", "bcnn-8-single"])
def test_a_single_bounce_needs_no_repetition(name: str) -> None:
    network = Network(find_model(name), SIZE, "cpu")
    assert with_bounces(network, 1) is network


@pytest.mark.parametrize(("model", "bounces", "said"), [
    ("gather", 2, f"--bounces: gather computes a single bounce (expected 1, {ADVICE})"),
    ("ssgi", 2, f"--bounces: ssgi computes a single bounce (expected 1, {ADVICE})"),
    ("bcnn-8", 3, f"--bounces: bcnn-8 always computes all bounces (expected none, {ADVICE})"),
    ("gfa-8", 1, f"--bounces: gfa-8 always computes all bounces (expected none, {ADVICE})"),
    ("none", 1, "--bounces: needs a network (expected a --model that computes indirect light)"),
])
def test_others_are_refused_in_one_line(model: str, bounces: int, said: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    run = CliRunner().invoke(cli, ["--size", "8x6", "--model", model, "--bounces", str(bounces), "--out", str(out)])
    assert run.exit_code == 2
    assert [line for line in run.stderr.splitlines() if not line.startswith("note:")] == [f"error: {said}"]
    assert not out.exists()
