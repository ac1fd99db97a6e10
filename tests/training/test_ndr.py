"""NDR: its initial output, inputs and loss, and its training on scenes under skies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("lightning_fabric")

from app.errors import SettingsError  # noqa: E402
from app.golden.scenes import dusk  # noqa: E402
from app.scene import Material  # noqa: E402
from export.models import PRESETS, count_weights, make_network  # noqa: E402
from export.models.ndr import MIN_SHADING  # noqa: E402
from export.onnx.export import to_half, write_network  # noqa: E402
from export.onnx.sample_inputs import sample_inputs  # noqa: E402
from export.training.augment import permute_colors  # noqa: E402
from export.training.config import config_from_table  # noqa: E402
from export.training.examples import Examples, render_missing  # noqa: E402
from export.training.loop import Run  # noqa: E402
from export.training.losses.loss_inputs import LossInputs  # noqa: E402
from export.training.losses.ndr import NdrLoss  # noqa: E402
from tests.training.pairs import CornellPairs, Target  # noqa: E402
from tests.training.test_training import config  # noqa: E402


def network(**options: object) -> torch.nn.Module:
    torch.manual_seed(0)
    return make_network("ndr-8", options).eval()


def room(net: torch.nn.Module) -> dict[str, torch.Tensor]:
    rooms = [tensors for label, tensors in sample_inputs(net.contract) if label == "room"]
    return {t: torch.from_numpy(x) for t, x in max(rooms, key=lambda tensors: tensors["x"].size).items()}


@torch.no_grad()
def test_a_new_network_returns_the_unshadowed_shading() -> None:
    net = network()
    inputs = room(net)
    unshadowed = inputs["x"][:, 5:]
    torch.testing.assert_close(net(**inputs), unshadowed.clamp(min=0) + MIN_SHADING, rtol=1e-4, atol=1e-5)


@torch.no_grad()
def test_black_input_and_sky_stay_black() -> None:
    """Black light stays below the offset of the shading, and the sky is exactly 0."""
    net = network()
    inputs = room(net)
    inputs["x"][:, 5:] = 0
    assert net(**inputs).max() <= 1.01 * MIN_SHADING
    inputs["x"][..., :20, :] = 0
    assert not net(**inputs)[..., :20, :].any()


@pytest.mark.parametrize("options", [{}, {"harmonics": False}, {"depth": False}, {"unshadowed": False},
                                     {"decoders": 1}], ids=str)
def test_each_variant_becomes_onnx(options: dict[str, object], tmp_path: Path) -> None:
    net = network(**options)
    for p in net.parameters():  # so that the output differs from the unshadowed shading
        p.data += 0.02 * torch.randn_like(p)
    inputs = list(sample_inputs(net.contract))
    write_network(net, tmp_path, inputs, {label: 1e-4 for label, _ in inputs})
    if not options:
        write_network(to_half(net), tmp_path, inputs, {label: 2e-2 for label, _ in inputs}, net)


def test_two_decoders_have_few_more_weights() -> None:
    assert {"ndr-paper", "ndr-16", "ndr-8"} <= PRESETS.keys()
    one, two = (count_weights(network(decoders=n)) for n in (1, 2))
    assert one < two < 1.6 * one


def test_the_loss_is_zero_for_the_reference_and_sees_each_kind_of_light() -> None:
    rng = torch.Generator().manual_seed(0)
    reference = torch.rand(2, 6, 24, 32, generator=rng)
    ones, reflectance = torch.ones(2, 1, 24, 32), torch.rand(2, 6, 24, 32, generator=rng)
    inputs = LossInputs(reference, reference, None, ones, ones, None, reflectance)
    loss = NdrLoss(l1=1.0)
    assert max(float(t) for t in loss(inputs).values()) < 1e-5
    for part, name in ((slice(0, 3), "diffuse"), (slice(3, 6), "specular")):
        wrong = reference.clone()
        wrong[:, part] = 0.5
        terms = loss(replace(inputs, output=wrong))
        assert terms[name] > 0.1 and terms["final"] > 0.01 and terms["l1"] > 0.01
        assert terms["specular" if name == "diffuse" else "diffuse"] < 1e-5


class SkyPairs(CornellPairs):
    """The Cornell box with a specular material, lit by an environment only."""

    @property
    def lit(self) -> object:
        if not hasattr(self, "_lit"):
            materials = tuple(replace(m, emission=(0.0,) * 3, roughness=0.4, specular=(0.5,) * 3, is_light_proxy=False)
                              if isinstance(m, Material) else m for m in self.scene.materials)
            self._lit = replace(self.scene, lights=(), materials=materials, environment=dusk().environment)
        return self._lit

    def pair(self, index: int):  # type: ignore[no-untyped-def]
        pair = super().pair(index)
        return replace(pair, **{k: replace(getattr(pair, k), scene=self.lit) for k in ("previous", "current")})

    def target(self, index: int) -> Target:
        light = super().target(index).layers["indirect"]
        return Target({"diffuse": light, "specular": 0.5 * light, "albedo": np.full_like(light, 0.6),
                       "reflectance": np.full_like(light, 0.3)}, np.ones(light.shape[:2], bool))


@pytest.mark.gl
def test_it_trains_on_frames_rendered_under_a_sky(tmp_path: Path) -> None:
    pairs, contract = SkyPairs(tmp_path, 6), make_network("ndr-8").contract
    assert sum(render_missing(pairs, contract, workers=1)) == 6
    examples = Examples(pairs, contract)
    batch = examples.batch([0, 3])
    assert batch["current.x"].shape == (2, 11, 24, 32) and batch["current.sky"].shape == (2, 75)
    assert batch["target"].shape == batch["reflectance"].shape == (2, 6, 24, 32)
    torch.testing.assert_close(batch["target"][:, 3:], 0.5 * batch["target"][:, :3], rtol=2e-3, atol=1e-4)
    surface = batch["current.x"][:, :3].abs().sum(1) > 0
    unshadowed = batch["current.x"][:, 5:].mean(1)[surface]
    assert unshadowed.mean() == pytest.approx(1.0, rel=0.15), "light is relative to the mean of the unshadowed shading"
    order = torch.tensor([[2, 0, 1], [0, 1, 2]])
    permuted = permute_colors(batch, contract, order)
    for name in ("target", "reflectance"):
        assert torch.equal(permuted[name][0, 3:], batch[name][0, 3:][[2, 0, 1]])
    table = config(tmp_path).to_json()
    table |= {"network": {"preset": "ndr-8"}, "loss": {"kind": "ndr", "options": {"l1": 1.0}}}
    table["schedule"] |= {"epochs": 30, "batch": 2, "ema": 0.5}
    run = Run(config_from_table(table, "test"), examples, tmp_path / "run")
    before = run.validate()["loss"]
    assert run.train()["loss"] < 0.7 * before
    assert (tmp_path / "run" / "pictures" / "0030.png").exists()


def test_a_dataset_with_the_wrong_kind_of_light_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from types import SimpleNamespace

    import export.dataset
    from export.training.cli import train

    monkeypatch.setattr(export.dataset, "Dataset", lambda folder: SimpleNamespace(
        config=SimpleNamespace(environment=False)))
    configs = Path(__file__).parents[2] / "export" / "training" / "configs"
    with pytest.raises(SettingsError, match="wrong kind of light"):
        train(configs / "ndr-8.toml", tmp_path, tmp_path)
