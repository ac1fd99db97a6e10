"""Running a network: agreement with its contract, exposure, padding, and numbers that stay numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from app.errors import DeviceError, ModelError, SettingsError
from app.network.channels import HALF_MAX
from app.network.contract import ModelContract, TensorSpec
from app.network.contract_json import contract_to_json, read_contract
from app.network.inputs import prepare_inputs
from app.network.providers import list_providers
from app.network.selection import bundled_models, find_model
from app.network.session import Network
from tests.rooms import Arrays, Lamp, View, box, tensors
from tests.tiny_network import TINY, write_tiny_network

SIZE = (9, 7)
INVALID = (np.nan, np.inf, -np.inf, -100.0, 1e30)


@pytest.fixture
def tiny(tmp_path: Path) -> Network:
    return Network(write_tiny_network(tmp_path / "tiny.onnx"), SIZE)


@pytest.fixture(scope="module", params=["gather", "radiosity"])
def bundled(request: pytest.FixtureRequest) -> Network:
    return Network(find_model(request.param), SIZE, provider="cpu")


def lit(value: float = 0.01) -> Arrays:
    x = np.zeros((6, SIZE[1], SIZE[0]), np.float32)
    x[:3], x[4] = value, 1.0
    return {"x": x}


def room(network: Network, lamp: float = 1.0) -> Arrays:
    view = View((12, 11, 33), (25, 10, 0), SIZE)
    return tensors(network.contract, box((40, 30, 40)), view, Lamp((20, 25, 20), lamp))


def test_output_is_named_by_channel_and_cropped(tiny: Network) -> None:
    out = tiny.run(lit())
    assert list(out) == ["indirect.rgb"]
    assert out["indirect.rgb"].shape == (3, SIZE[1], SIZE[0]) and out["indirect.rgb"].dtype == np.float32
    np.testing.assert_allclose(out["indirect.rgb"], 0.005, rtol=1e-6)


def test_padding_repeats_the_edge(tiny: Network) -> None:
    x = lit()
    x["x"][:3, :, -1] = 0.02
    # 9x7 becomes 12x8: the last column counts four times, the last row twice.
    expected = 0.5 * (8 * 0.01 + 4 * 0.02) / 12
    np.testing.assert_allclose(tiny.run(x)["indirect.rgb"], expected, rtol=1e-5)


def test_resize_takes_any_size(tiny: Network) -> None:
    for w, h in ((1, 1), (13, 5), SIZE):
        tiny.resize((w, h))
        x = np.ones((6, h, w), np.float32)
        assert tiny.run({"x": x})["indirect.rgb"].shape == (3, h, w)


def test_the_input_is_left_untouched(bundled: Network) -> None:
    x = room(bundled)
    before = {t: v.copy() for t, v in x.items()}
    bundled.run(x)
    for t in x:
        np.testing.assert_array_equal(x[t], before[t])


def test_a_read_only_tensor_is_prepared_once() -> None:
    network = Network(find_model("radiosity"), SIZE, provider="cpu")
    x = room(network)

    def light(bounces: np.ndarray) -> float:
        return float(network.run(x | {"bounces": bounces})["indirect.rgb"].mean())

    number = np.full(1, 1, np.float32)
    given = number.view()
    given.flags.writeable = False
    once = light(given)
    number[:] = 3
    assert light(given) == once
    thrice = light(number)
    assert thrice > 1.1 * once
    number[:] = 1
    assert light(number) == once
    number[:] = 3
    network.resize(SIZE)
    assert light(given) == thrice


def mean_of(network: Network, x: np.ndarray) -> float:
    return prepare_inputs(network.contract, {"x": x}, {"x": np.empty_like(x)})


def test_the_sky_does_not_count_in_the_exposure(tiny: Network) -> None:
    half = lit()
    half["x"][:, :, 4:] = 0
    half["x"][:3, :, 4:] = 77.0  # a colour that belongs to no surface
    shown = tiny.run(half)["indirect.rgb"]
    assert mean_of(tiny, half["x"]) == pytest.approx(0.01)
    np.testing.assert_allclose(shown, 0.5 * 0.01 * 4 / 12, rtol=1e-5)


@pytest.mark.parametrize("alpha", [1e-6, 1e6])
def test_twice_the_light_is_twice_the_indirect_light(bundled: Network, alpha: float) -> None:
    x = room(bundled)
    once = bundled.run(x)["indirect.rgb"]
    assert 0 < once.max() * alpha < HALF_MAX
    many = bundled.run(room(bundled, lamp=alpha))["indirect.rgb"]
    np.testing.assert_allclose(many, once * np.float32(alpha), rtol=1e-4, atol=1e-6 * alpha * once.max())


def test_black_stays_exactly_black(bundled: Network, tiny: Network) -> None:
    assert not bundled.run(room(bundled, lamp=0.0))["indirect.rgb"].any()
    assert not tiny.run(lit(0.0))["indirect.rgb"].any()


def test_a_firefly_does_not_darken_the_rest(tmp_path: Path) -> None:
    network = Network(write_tiny_network(tmp_path / "tiny.onnx"), (64, 48))
    x = np.full((6, 48, 64), 1.0, np.float32)
    clean = mean_of(network, x)
    x[:3, 3, 3] = 1e5
    assert clean <= mean_of(network, x) <= 1.5 * clean


def test_light_on_few_texels_still_counts(tmp_path: Path) -> None:
    """A sun patch on a hundredth of the texels is not taken for fireflies."""
    network = Network(write_tiny_network(tmp_path / "tiny.onnx"), (64, 48))
    x = np.zeros((6, 48, 64), np.float32)
    x[4] = 1.0
    x[:3, 0, :31] = 2.0
    assert mean_of(network, x) >= 0.1 * 2.0 * 31 / (64 * 48)


def test_light_on_panoramas_is_not_clamped() -> None:
    """Four of 2048 texels; on the screen or a cube they would count for a sixteenth."""
    contract = ModelContract(
        name="x", inputs={"screen": TensorSpec(("position.view.xyz",)),
                          "around": TensorSpec(("depth", "surface_and_sky_radiance.rgb"), "panorama", 32)},
        outputs={"y": TensorSpec(("indirect.rgb",))}, scale=1.0, exposure="mean-radiance", bounces="multi",
        scene_extent=40.0, cube_axes="camera")
    given = {"screen": np.ones((3, 4, 4), np.float32), "around": np.ones((4, 32, 64), np.float32)}
    given["around"][1:] = 0.0
    given["around"][1:, 7, 3:7] = 8.0
    out = {t: np.empty_like(x) for t, x in given.items()}
    assert prepare_inputs(contract, given, out) == pytest.approx(8.0 * 4 / 2048)
    np.testing.assert_allclose(out["around"][1:, 7, 3:7], 2048 / 4)


def test_a_firefly_has_bounded_influence(bundled: Network) -> None:
    x = room(bundled, lamp=1000.0)
    calm = bundled.run(x)["indirect.rgb"]
    radiance = dict(bundled.contract.inputs["screen"].rows())["radiance.rgb"]
    x["screen"][radiance, 3, 4] = 1e5
    wild = bundled.run(x)["indirect.rgb"]
    assert np.isfinite(wild).all() and wild.max() < HALF_MAX
    assert (wild >= 0.9 * calm).all()


@pytest.mark.parametrize("value", INVALID)
@pytest.mark.parametrize("some", [True, False])
def test_non_finite_inputs_give_finite_outputs(bundled: Network, tiny: Network, value: float, some: bool) -> None:
    rng = np.random.default_rng(0)
    for network, clean in ((bundled, room(bundled)), (tiny, lit())):
        x = {t: np.where(rng.random(v.shape) < (0.1 if some else 2), np.float32(value), v) for t, v in clean.items()}
        out = network.run(x)["indirect.rgb"]
        assert np.isfinite(out).all()
        assert out.min() >= 0 and out.max() <= HALF_MAX
        # The next frame is not affected.
        assert np.isfinite(network.run(clean)["indirect.rgb"]).all()


def test_repeated_runs_match_exactly(bundled: Network) -> None:
    x = room(bundled)
    np.testing.assert_array_equal(bundled.run(x)["indirect.rgb"], bundled.run(x)["indirect.rgb"])


def test_wrong_channel_counts_are_refused(tmp_path: Path) -> None:
    path = write_tiny_network(tmp_path / "seven.onnx", channels=7)
    with pytest.raises(ModelError, match=r"input 'x' of the graph has the shape \[1, 7, 'h', 'w'\].*expected \[1, 6"):
        Network(path, SIZE)


@pytest.mark.parametrize(("said", "instead", "message"), [
    ('"x"', '"picture"', r"inputs are \['picture'\].*expected the graph's inputs \['x'\]"),
    ("float32", "float16", r"expected tensor\(float16\)"),
    ("direct.rgb", "magic.rgb", r"other\.onnx: unknown channel 'magic.rgb'"),
], ids=["tensor name", "dtype", "channel"])
def test_a_contract_that_says_something_else_is_refused(tmp_path: Path, said: str, instead: str, message: str) -> None:
    path = write_tiny_network(tmp_path / "other.onnx", contract_to_json(TINY).replace(said, instead))
    with pytest.raises(ModelError, match=message):
        Network(path, SIZE)


def test_a_graph_that_onnxruntime_does_not_know_is_refused(tmp_path: Path) -> None:
    path = write_tiny_network(tmp_path / "op.onnx")
    path.write_bytes(path.read_bytes().replace(b"ReduceMean", b"ReduceFoam"))
    with pytest.raises(ModelError, match="onnxruntime can't load the network") as caught:
        Network(path, SIZE)
    assert "\n" not in str(caught.value)


def test_a_shape_that_goes_wrong_later_is_refused(tmp_path: Path) -> None:
    network = Network(write_tiny_network(tmp_path / "late.onnx", output_width="first"), SIZE)
    with pytest.raises(ModelError, match=r"output 'y' has the shape \[1, 3, 8, 11\] \(expected \[1, 3, 8, 12\]\)"):
        network.run(lit())


def test_the_provider_that_runs_is_named(tiny: Network) -> None:
    assert tiny.provider in list_providers()
    assert "azure" not in list_providers()


def test_an_unknown_provider_lists_the_known_ones(tmp_path: Path) -> None:
    path = write_tiny_network(tmp_path / "tiny.onnx")
    with pytest.raises(SettingsError, match=r"no provider 'abacus' .*expected one of: auto, .*cpu"):
        Network(path, SIZE, provider="abacus")


def test_strict_refuses_a_fallback(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_tiny_network(tmp_path / "tiny.onnx")
    Network(path, SIZE, provider="cpu", strict=True)
    if "cuda" in list_providers():
        pytest.skip("this onnxruntime has CUDA, so nothing falls back")
    monkeypatch.setattr("app.network.providers.list_providers", lambda: ["cuda", "cpu"])
    with pytest.raises(DeviceError, match=r"runs on 'cpu'.*expected 'cuda'"):
        Network(path, SIZE, provider="cuda", strict=True)


def test_contracts_are_read_without_a_session() -> None:
    assert all(read_contract(path).inputs for path in bundled_models().values())
